"""Set up, check and read the board that measures the cords."""
