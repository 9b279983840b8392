"""Errors of runs relative to a reference."""
