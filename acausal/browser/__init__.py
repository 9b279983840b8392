"""One-file pages for a browser: the libraries they embed, and how they are put together. Nothing is fetched.

| file | what | from | licence |
|---|---|---|---|
| three.bundle.min.js | three.js with its glTF loader and orbit controls | npm three 0.187.0, bundled by esbuild | MIT |
| uPlot.iife.min.js, uPlot.min.css | uPlot | npm uplot 1.6.32, unmodified | MIT |
| elk-worker.min.js | the layout algorithms of ELK | npm elkjs 0.12.1, unmodified | EPL-2.0 |

`LICENSES.md` has the licences and the command that made the bundle.
"""
