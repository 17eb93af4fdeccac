"""Interactive design: judge cords, preview poses, and compare layouts while a person works."""
