"""Use the geometry kernels OpenCascade and manifold3d, and query surfaces."""
