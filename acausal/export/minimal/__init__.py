"""Minimal coordinates: two states for each degree of freedom."""
