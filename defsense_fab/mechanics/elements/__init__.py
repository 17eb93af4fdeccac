"""Materials and quadratic tetrahedra: energy, stress, tangent and points in elements."""
