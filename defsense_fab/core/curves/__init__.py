"""Paths of cords, and points along them."""
