"""The step Poses: regions, poses that hold and move them, and their shapes."""
