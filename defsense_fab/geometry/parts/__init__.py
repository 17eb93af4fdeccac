"""Printable parts: the body cut along cord planes, pinned, numbered, inspected."""
