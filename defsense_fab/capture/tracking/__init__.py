"""From tags in images to tracks of markers."""
