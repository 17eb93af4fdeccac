"""The geometry kernels (OpenCascade, manifold3d) and what both cut and measure."""
