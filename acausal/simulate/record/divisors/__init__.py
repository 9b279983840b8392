"""Divisors and determinants along a run: those that pass zero, and eliminations that they spoil."""
