"""Modes of a run, and the stability of each method on them."""
