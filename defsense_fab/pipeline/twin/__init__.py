"""A built device and its read-out board as a twin."""
