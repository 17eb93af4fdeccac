"""From videos of several cameras to tracks of markers."""
