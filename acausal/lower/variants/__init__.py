"""A compiled model with something changed, without compiling it again."""
