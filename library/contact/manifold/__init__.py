"""Where two shapes touch: points, depths, normals."""
