"""The moving surface recorded, and written as an animation for other programs."""
