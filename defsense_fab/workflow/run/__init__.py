"""Run a device live: its options, its files, the source of its samples, and the run itself."""
