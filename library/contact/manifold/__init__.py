"""Contact manifolds of two shapes: points, depths, normals."""
