"""`python -m acausal`: the command line."""

from __future__ import annotations

from acausal_command import run

run()
