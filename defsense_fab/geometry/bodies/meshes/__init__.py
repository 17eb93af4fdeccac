"""Files of triangles and tetrahedra: told apart, and read."""
