"""Materials, quadratic tets, Newton: poses to displacement fields."""
