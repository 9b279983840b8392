"""Stability limits of fixed steps."""
