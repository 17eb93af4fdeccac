"""Training sessions that a twin gives, with tracks or filmed."""
