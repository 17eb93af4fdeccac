"""Named signals of a deformation: how far it is bent, twisted, pulled."""
