"""Ready models, imported as `acausal.models`."""

from __future__ import annotations

# From the repository's root this folder is importable as `models` too, and every class would then exist twice.
if not __name__.startswith("acausal."):
    raise ImportError("import acausal.models instead of models: under two names every class would exist twice")
