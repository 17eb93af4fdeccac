"""Materials and quadratic tets: energy, stress, tangent, points in elements."""
