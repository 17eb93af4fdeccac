"""Make models from datasets and simulations, store them, and recalibrate them."""
