"""Cameras calibrated, arranged and checked."""
