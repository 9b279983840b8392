"""The broken models cover every class of structural and start error."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from tests.messages.cases import Corpus


def test_every_class_of_structural_and_start_error_occurs() -> None:
    """AC208 occurs by hand only: the numbers explain every model that we know before Pantelides' algorithm has to."""
    files = Path(__file__).parent.glob("test_*.py")
    found = (getattr(import_module(f"tests.messages.{file.stem}"), "corpus", Corpus()) for file in files)
    codes = {case.code for corpus in found for case in corpus.cases}
    assert codes >= {f"AC20{k}" for k in range(1, 10)} | {f"AC30{k}" for k in (1, 2, 3, 4)}
