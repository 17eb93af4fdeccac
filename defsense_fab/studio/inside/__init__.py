"""The mode in which one looks into the body: how a section of it is stretched, and where another
cord would help."""
