"""The page of the studio: the body and its cords in three dimensions, and what is said of them."""
