"""The optimization problem: cords, their signals, the objective and its derivatives."""
