"""Records, their invariants, and the error tree. NumPy only."""
