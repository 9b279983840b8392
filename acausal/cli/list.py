"""`acausal list`: the models that are shipped."""

from __future__ import annotations

from acausal.cli.options import JsonOption
from acausal.cli.report import record, table
from acausal.cli.shipped import shipped_models


def list_models(as_json: JsonOption = False) -> None:
    """List the shipped models: name, module, what they show."""
    found = shipped_models()
    if as_json:
        record({"models": [{"name": m.name, "reference": m.reference, "summary": m.summary} for m in found]})
    else:
        table([(m.name, m.module, m.summary) for m in found])
