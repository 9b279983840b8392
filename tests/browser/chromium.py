"""Pages in a headless Chromium: what a script finds there, as numbers."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--virtual-time-budget=8000",
    "--window-size=1200,800",
    "--dump-dom",
)


def browser() -> str:
    """Path of a Chromium; the test is skipped where there is none."""
    wanted = os.environ.get("ACAUSAL_CHROMIUM")
    found = wanted or next((path for name in _NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no Chromium on this machine: install one, or name it in ACAUSAL_CHROMIUM")
    return found


def probe(page: str, script: str, folder: Path) -> Any:
    """What `script`, the body of an async function, returns in the page; fails where the page itself fails.

    The page has no network: it is opened from a file, and every request would be an error.
    """
    program = browser()
    text = (
        "<script>(async () => { let found; try { found = {value: await (async () => {"
        + script
        + "})()}; } catch (error) { found = {error: String(error) + ' ' + (error.stack || '')}; }"
        + "const place = document.createElement('pre'); place.id = 'probe';"
        + "place.textContent = JSON.stringify(found); document.body.appendChild(place); })();</script>"
    )
    file = folder / "probe.html"
    file.write_text(page.replace("</body>", text + "</body>"), encoding="utf-8")
    run = subprocess.run(
        [program, *_FLAGS, f"--user-data-dir={folder / 'profile'}", file.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    match = re.search(r'<pre id="probe">(.*?)</pre>', run.stdout, re.DOTALL)
    assert match is not None, f"the page did not answer: {run.stderr[-2000:]}"
    found = json.loads(html.unescape(match[1]))
    assert "error" not in found, found["error"]
    return found.get("value")
