"""The mode in which the body's parameters, the material, cord and printer are chosen."""
