"""The mode in which cords are optimised before one's eyes, and layouts are compared."""
