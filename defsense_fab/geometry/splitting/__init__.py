"""Cut parts that are too long for a bed into pieces."""
