"""A built device and its board as a twin."""
