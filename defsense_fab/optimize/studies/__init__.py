"""Studies of layouts: number of cords, tolerances, risks."""
