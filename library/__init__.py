"""Component libraries, imported as `acausal.library`."""

from __future__ import annotations

# From the root of the repository this folder is importable as `library` too, which would duplicate every class.
if not __name__.startswith("acausal."):
    raise ImportError("import acausal.library instead of library: under two names every class would exist twice")
