"""Runs of models whose structure depends on their state."""
