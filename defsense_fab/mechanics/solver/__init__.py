"""Newton's method, load stepping, batches, modes, and fields read from solutions."""
