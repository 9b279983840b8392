"""Connections between components, and the equations and choices that follow from them."""
