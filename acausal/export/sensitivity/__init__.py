"""Derivatives of a run by its parameters, through its events."""
