"""Load, repair and mesh the body of a device, and place its connector bay and tags."""
