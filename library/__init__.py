"""Component libraries, imported as `acausal.library`."""

from __future__ import annotations

# From the repository's root this folder is importable as `library` too, and every class would then exist twice.
if not __name__.startswith("acausal."):
    raise ImportError("import acausal.library instead of library: under two names every class would exist twice")
