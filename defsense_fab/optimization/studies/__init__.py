"""Study layouts: number of cords, tolerances and risks."""
