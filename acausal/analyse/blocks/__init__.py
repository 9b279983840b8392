"""Symbolic solution of the blocks of the block lower triangular form."""
