"""Expressions, of which equations consist, and the functions that make them."""
