"""Common configuration of all tests: reference data, a windowless plotting backend, property tests without deadline."""

from __future__ import annotations

import gc
import os
import tempfile
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import settings

from acausal.simulate.native import cache
from tests.slow_cases import COLLECTED, is_slow

# The developer's cache of compiled models is neither used nor changed.
os.environ.setdefault("ACAUSAL_CACHE", str(Path(tempfile.gettempdir()) / "acausal-tests"))
# Set here, before any test can import matplotlib.
os.environ["MPLBACKEND"] = "Agg"

# Tests share the processor with other processes: a deadline per example would measure these rather than the code.
# In CI the few examples of a property are the same in every run; elsewhere a hundred others are drawn each time.
CI = "CI" in os.environ
settings.register_profile("acausal", deadline=None, derandomize=CI, max_examples=25 if CI else 100)
settings.load_profile("acausal")

ROOT = Path(__file__).resolve().parents[1]

# Tests of compiled code itself, whose slow cases compile with optimisation, as users do.
OPTIMISED = ("tests/simulate/test_native.py", "tests/simulate/test_native_columns.py")
USERS_FLAGS = cache.FLAGS
cache.FLAGS = ("-O0", *USERS_FLAGS[1:])


@pytest.fixture(autouse=True)
def flags(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile C without optimisation, in a fifth of the time: tests assert numbers, which do not depend on it."""
    item: pytest.Item = request.node
    if item.get_closest_marker("slow") is not None and item.nodeid.startswith(OPTIMISED):
        monkeypatch.setattr(cache, "FLAGS", USERS_FLAGS)


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """One of two workers imports the files of the whole suite from the last to the first.

    Each would rewrite the asserts of all files, which takes 10 s; so it reads those that the other has rewritten.
    """
    if (
        os.environ.get("PYTEST_XDIST_WORKER") == "gw1"
        and session.config.args_source is not session.config.ArgsSource.ARGS
    ):
        for file in sorted(ROOT.glob("tests/**/test_*.py"), reverse=True):
            with suppress(Exception, pytest.skip.Exception):  # pytest reports it when it collects the file
                import_module(".".join(file.relative_to(ROOT).with_suffix("").parts))


@pytest.hookimpl(tryfirst=True)  # before pytest deselects slow tests
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the cases listed in `slow_cases.txt` as slow."""
    for item in items:
        if is_slow(item.nodeid):
            item.add_marker(pytest.mark.slow)
    slow = {item.nodeid: item.get_closest_marker("slow") is not None for item in items}
    config.stash[COLLECTED] = {} if any("::" in argument for argument in config.args) else slow


def pytest_collection_finish() -> None:
    """Exclude imported and collected objects from garbage collection, which took a tenth of the total time."""
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
