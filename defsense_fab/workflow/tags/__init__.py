"""A device's tags: which, where, and the sheets to print."""
