"""Twins in real time: in place of a read-out board, of cameras, or of a whole device."""
