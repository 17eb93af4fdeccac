"""Tracks in CSV, NPZ, Parquet, C3D and TRC."""
