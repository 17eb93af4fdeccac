"""The bending specimen, its jigs and the fit coupon."""
