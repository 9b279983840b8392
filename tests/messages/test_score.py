"""The score of the diagnosis: the right class of error, and the right thing named in the first two lines, for all."""

from __future__ import annotations

from importlib import import_module

import pytest

import acausal
from tests.messages.cases import Case, normalised

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


def test_every_broken_model_is_explained_in_two_lines() -> None:
    """Thirty broken models at least; each message begins with class and component, then says file and line."""
    right = 0
    for case in BROKEN_MODELS:
        with pytest.raises(acausal.AcausalError) as caught:
            case.run()
        first, second, *_ = normalised(caught.value).splitlines()
        is_right = first.startswith(f"error[{case.code}]: ") and case.named in first
        right += is_right and second.startswith("  at      ") and second.endswith(".py:N")
    assert len(BROKEN_MODELS) >= 30
    assert right == len(BROKEN_MODELS)


def test_every_class_of_structural_and_start_error_occurs() -> None:
    """AC208 occurs by hand only: the numbers explain every model that we know before Pantelides' algorithm has to."""
    codes = {case.code for case in BROKEN_MODELS}
    assert codes >= {f"AC20{k}" for k in range(1, 10)} | {f"AC30{k}" for k in (1, 2, 3, 4)}
