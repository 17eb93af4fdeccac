"""What the command line draws where more than lines are needed."""
