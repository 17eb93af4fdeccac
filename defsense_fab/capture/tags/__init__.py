"""Camera tags and ChArUco boards: patterns, detection, and sheets to print."""
