"""Compiled C instead of CasADi's interpreter: kept on disk, made when it pays, never required.

`cache.py` finds and builds libraries and the functions in them, `source.py` writes C, `program.py` calls whole
integrators, `policy.py` decides. Measurements: docs/devdocs/native.md.
"""
