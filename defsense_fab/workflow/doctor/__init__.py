"""Checks of the machine and its libraries."""
