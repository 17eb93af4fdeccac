"""Train models from recordings or a simulation, evaluate and recalibrate them, export data."""
