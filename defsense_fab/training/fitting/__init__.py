"""Decoders chosen and fitted, with their intervals and limits; re-calibrated."""
