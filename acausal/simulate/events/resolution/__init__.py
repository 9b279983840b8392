"""Whether the mesh points of a search resolve its guards, and where more points are needed."""
