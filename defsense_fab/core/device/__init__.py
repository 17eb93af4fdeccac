"""What `device.toml` says, checked, as records; the catalogues of materials and cords."""
