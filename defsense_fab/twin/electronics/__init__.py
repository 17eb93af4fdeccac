"""The twin's cords and its read-out board."""
