"""Full-screen displays of the command line, and single keys."""
