"""A training session while it is recorded."""
