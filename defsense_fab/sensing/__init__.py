"""Cord signals, decoders, error measures, and the floor."""
