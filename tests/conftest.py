"""What all tests share: the reference data, a windowless plotting backend, and property tests without a stop watch."""

from __future__ import annotations

import gc
import os
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

from acausal.simulate.native import cache
from tests.slow_cases import COLLECTED, is_slow

# Compiled libraries of the developer's own models are neither used nor added to.
os.environ.setdefault("ACAUSAL_CACHE", str(Path(tempfile.gettempdir()) / "acausal-tests"))
# Set here, before any test can import matplotlib.
os.environ["MPLBACKEND"] = "Agg"

# Runs share the processor with others: a deadline per example would measure them, not the code.
settings.register_profile("acausal", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("acausal")

ROOT = Path(__file__).resolve().parents[1]

# Where compiled code itself is on trial: there the slow part compiles as users do.
OPTIMISED = ("tests/simulate/test_native.py", "tests/simulate/test_native_columns.py")
USERS_FLAGS = cache.FLAGS
cache.FLAGS = ("-O0", *USERS_FLAGS[1:])


@pytest.fixture(autouse=True)
def flags(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """C is compiled without optimisation in a fifth of the time: tests assert numbers, and those are the same."""
    item: pytest.Item = request.node
    if item.get_closest_marker("slow") is not None and item.nodeid.startswith(OPTIMISED):
        monkeypatch.setattr(cache, "FLAGS", USERS_FLAGS)


@pytest.hookimpl(tryfirst=True)  # before pytest leaves out what is marked as slow
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long cases are slow."""
    for item in items:
        if is_slow(item.nodeid):
            item.add_marker(pytest.mark.slow)
    slow = {item.nodeid: item.get_closest_marker("slow") is not None for item in items}
    config.stash[COLLECTED] = {} if any("::" in argument for argument in config.args) else slow


def pytest_collection_finish() -> None:
    """What was imported and collected stays: to look through it again took a tenth of all time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


@pytest.fixture(scope="session")
def reference() -> Path:
    """Folder of published problems and oracle numbers; the environment variable ACAUSAL_REFERENCE overrides it."""
    folder = Path(os.environ.get("ACAUSAL_REFERENCE", ROOT.parent / "shared" / "reference"))
    if not folder.is_dir():
        pytest.skip(f"no reference data at {folder}; set ACAUSAL_REFERENCE to their folder")
    return folder
