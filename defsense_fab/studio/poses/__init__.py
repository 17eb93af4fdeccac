"""The mode in which the user defines regions and poses, and the body follows."""
