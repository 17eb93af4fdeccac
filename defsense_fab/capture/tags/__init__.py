"""Camera tags and ChArUco boards: patterns, detection, sheets to print."""
