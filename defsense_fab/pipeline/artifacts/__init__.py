"""Typed records of everything that a build or a session leaves on disk."""
