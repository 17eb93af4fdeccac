"""From readings to positions: ridge regression, kernels, folds, error measures, the floor."""
