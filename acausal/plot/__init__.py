"""Plots of results and of the structure of models."""
