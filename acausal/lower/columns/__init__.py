"""Repeated components as operations on columns."""
