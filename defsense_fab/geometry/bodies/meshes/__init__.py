"""Triangle meshes of any origin: read from files, and made into closed surfaces."""
