"""Ready models, imported as `acausal.models`."""

from __future__ import annotations

# From the root of the repository this folder is importable as `models` too, which would duplicate every class.
if not __name__.startswith("acausal."):
    raise ImportError("import acausal.models instead of models: under both names every class would exist twice")
