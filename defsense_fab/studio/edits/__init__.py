"""Edits of a device's file, one function for each kind of change."""
