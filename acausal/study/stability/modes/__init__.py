"""Modes of a run, and what each method makes of them."""
