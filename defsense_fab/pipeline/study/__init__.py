"""Studies of a device: number of cords, proposed poses, and any parameter by `study.toml`."""
