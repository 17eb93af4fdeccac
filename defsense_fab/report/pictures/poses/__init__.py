"""Pictures of the body in its poses: its strain, and by how much it is told wrongly."""
