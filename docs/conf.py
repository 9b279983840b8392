"""The site: `python -m sphinx -b html docs build/site` (pip install -e ".[docs]")."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import version as installed
from pathlib import Path

HERE = Path(__file__).resolve().parent
# Reference pages are made from the source, by a process of their own: a module of this name lies beside many others.
subprocess.run([sys.executable, str(HERE / "generate.py")], check=True)

project = "acausal"
author = "the founders of acausal"
release = version = installed("acausal")
sys.path.insert(0, str(HERE))
extensions = ["myst_nb", "mathml"]
html_math_renderer = "mathml"
exclude_patterns = ["images", "**/images"]
html_theme = "furo"
html_title = "acausal"
html_show_sphinx = False
html_copy_source = False
# "--set" is an option, not a dash.
smartquotes = False
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
# Pages run in every build, for the package may have changed under them; a cell that fails ends it.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_execution_show_tb = True
# Links to the README and to sources lead out of the site.
suppress_warnings = ["myst.xref_missing", "misc.highlighting_failure"]
