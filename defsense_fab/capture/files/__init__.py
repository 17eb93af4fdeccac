"""Files of tracks in CSV, NPZ, Parquet, C3D and TRC."""
