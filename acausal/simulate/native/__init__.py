"""Compiled C code in place of CasADi's interpreter: cached on disk, built when that pays off, never required.

`cache.py` finds and builds libraries and loads their functions, `source.py` writes C, `program.py` calls whole
integrators, `policy.py` decides when to compile. Measurements: docs/devdocs/native.md.
"""
