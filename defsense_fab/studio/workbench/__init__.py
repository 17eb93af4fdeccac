"""Code that all modes share: the page, the device, its poses, and background work."""
