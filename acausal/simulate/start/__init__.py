"""Consistent start values."""
