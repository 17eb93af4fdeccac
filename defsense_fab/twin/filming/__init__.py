"""The twin's device before its cameras."""
