"""A line and the faces of a shape through which it passes."""
