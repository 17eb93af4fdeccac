"""Devices begun: from one that comes with the package, or from a file of a body."""
