"""The mode in which cords are drawn while their expected error is told."""
