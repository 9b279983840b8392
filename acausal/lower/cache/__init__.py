"""Compiled models kept for models of the same structure, in memory and on disk."""
