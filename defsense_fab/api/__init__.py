"""The Python interface: a device simulated, its cords optimised and predicted, models trained."""
