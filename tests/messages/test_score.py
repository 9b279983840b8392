"""The broken models cover every class of structural and start error."""

from __future__ import annotations

from importlib import import_module

from tests.messages.cases import Case

_FILES = (
    "circuits",
    "class_bodies",
    "dependent",
    "heat_and_tables",
    "loops",
    "mechanisms",
    "prescribed_flows",
    "prescribed_twice",
    "references",
    "signals",
    "special_values",
    "start_messages",
    "unbalanced",
    "wrong_starts",
)
BROKEN_MODELS: list[Case] = [
    case for name in _FILES for case in import_module(f"tests.messages.test_{name}").corpus.cases
]


def test_every_class_of_structural_and_start_error_occurs() -> None:
    """AC208 occurs by hand only: the numbers explain every model that we know before Pantelides' algorithm has to."""
    codes = {case.code for case in BROKEN_MODELS}
    assert codes >= {f"AC20{k}" for k in range(1, 10)} | {f"AC30{k}" for k in (1, 2, 3, 4)}
