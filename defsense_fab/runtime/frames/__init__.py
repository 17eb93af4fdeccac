"""Decode samples of the read-out board into frames: marker positions with their quality."""
