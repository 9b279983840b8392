"""Displays of models and results in notebooks."""
