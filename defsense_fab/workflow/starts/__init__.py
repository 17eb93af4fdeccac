"""First devices: from examples of the package, and from files of bodies."""
