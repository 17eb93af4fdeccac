"""Maps from readings to positions: ridge regression, kernels, trained models, and their errors."""
