"""Numeric values of expressions at sample points."""
