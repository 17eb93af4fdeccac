"""Solve for equilibria: Newton's method, load stepping, batches, modes and fields."""
