"""A closed surface to tetrahedra, by several ways, until one is sound."""
