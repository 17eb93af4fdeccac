"""What an experiment is: its file, and the examples that come with the package."""
