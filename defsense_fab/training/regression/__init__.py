"""Ridge regression on camera frames: candidates, weights, intervals, and a simulation as a prior."""
