"""What is optimised: cords, their signals, the objective and its derivatives."""
