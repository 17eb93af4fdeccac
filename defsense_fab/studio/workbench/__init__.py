"""What all modes share: the page, the device and its simulated poses, builds beside it."""
