"""The points of a study: its file, parameters, devices and measures."""
