"""What the cords of a device are to do, what a layout is predicted to sense, and which is taken."""
