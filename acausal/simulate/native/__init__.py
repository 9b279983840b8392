"""Compiled C instead of CasADi's interpreter: kept on disk, made when it pays, never required.

`cache.py` finds and builds libraries, `source.py` writes C, `program.py` calls whole integrators, `functions.py` makes
CasADi functions of libraries, `policy.py` decides. Measurements: docs/devdocs/native.md.
"""
