"""Markers in, a whole deforming surface out, many times a second."""
