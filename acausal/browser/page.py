"""A page with its scripts, styles and data in one file, which works from a disk without a network."""

from __future__ import annotations

import base64
import gzip
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray


def asset(name: str) -> str:
    """Text of a file of this package; libraries are kept compressed, which is a quarter of their size."""
    folder = files("acausal.browser")
    smaller = folder.joinpath(f"{name}.gz")
    data = gzip.decompress(smaller.read_bytes()) if smaller.is_file() else folder.joinpath(name).read_bytes()
    return data.decode("utf-8")


@dataclass(frozen=True)
class Wrapped:
    """A script that is a CommonJS module; what it exports is in the constant `name`."""

    asset: str
    name: str

    def text(self) -> str:
        """The script in a function that gives it a module of its own."""
        head = f"const {self.name} = {{exports: {{}}}};\n(function (module, exports) {{\n"
        return f"{head}{asset(self.asset)}\n}})({self.name}, {self.name}.exports);"


def page(
    title: str, body: str, data: Mapping[str, Any], scripts: Sequence[str | Wrapped] = (), styles: Sequence[str] = ()
) -> str:
    """An HTML page; `data` is what its scripts find as `acausal`, `scripts` and `styles` are names of assets."""
    head = "".join(f"<style>\n{asset(name)}\n</style>\n" for name in ("page.css", *styles))
    # In a script no text may end it, whatever is in the model's names and docs.
    content = json.dumps(data, ensure_ascii=False, allow_nan=False).replace("</", "<\\/").replace("<!--", "<\\!--")
    texts = (name.text() if isinstance(name, Wrapped) else asset(name) for name in scripts)
    tail = "".join(f"<script>\n{text}\n</script>\n" for text in texts)
    return (
        "<!DOCTYPE html>\n"
        f'<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{html.escape(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"{head}</head>\n<body>\n{body}\n<script>const acausal = {content};</script>\n{tail}</body>\n</html>\n"
    )


def packed(values: NDArray[Any], precision: str = "<f4") -> str:
    """Numbers of any shape, row by row, as little-endian base64 text; what is not finite becomes nan."""
    data = np.asarray(values, dtype=float)
    data = np.where(np.isfinite(data), data, np.nan)
    with np.errstate(over="ignore"):
        return base64.b64encode(np.ascontiguousarray(data, dtype=precision).tobytes()).decode("ascii")
