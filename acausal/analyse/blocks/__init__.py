"""Blocks solved as far as symbols go."""
