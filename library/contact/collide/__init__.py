"""Collision kernel: shapes, support functions, Minkowski Portal Refinement."""
