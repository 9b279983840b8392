"""Declarations in class bodies: fields, parts, the default run, and errors in them."""
