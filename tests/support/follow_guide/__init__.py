"""Follow a built device's assembly guide literally, knowing only the geometry of the parts."""
