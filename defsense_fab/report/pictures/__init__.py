"""Draw pictures of bodies, parts, cords, poses and errors."""
