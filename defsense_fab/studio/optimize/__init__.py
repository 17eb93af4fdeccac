"""The mode that optimizes the cords while the user watches, and compares layouts."""
