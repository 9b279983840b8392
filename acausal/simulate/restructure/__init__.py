"""Runs of models whose structure follows their state."""
