"""The mode in which the user sets the body, the material, the cord and the printer."""
