"""The step Optimize: the search for cords, layouts side by side, and the error on the surface."""
