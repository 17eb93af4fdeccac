"""Bodies, tetrahedra, planes and curves, channels, splits, export."""
