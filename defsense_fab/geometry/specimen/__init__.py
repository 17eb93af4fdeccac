"""Make the bending specimen, its jigs and the fit coupon."""
