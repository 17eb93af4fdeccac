"""The mode in which the finished device is measured, trained and run."""
