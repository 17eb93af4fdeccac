"""Ridge regression on frames: candidates, weights, intervals, and the simulation as a prior."""
