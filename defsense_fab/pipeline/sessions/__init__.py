"""Training sessions: recorded, processed, reported."""
