"""Variants of a compiled model that need no new compilation."""
