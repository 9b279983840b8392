"""Intersections of a line with the faces of a shape."""
