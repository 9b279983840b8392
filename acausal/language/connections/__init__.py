"""Connections between components."""
