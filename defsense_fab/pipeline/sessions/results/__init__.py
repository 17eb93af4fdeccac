"""What a processed session is: its files and its report."""
