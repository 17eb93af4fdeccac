"""The runs of a study: their log, batches of them, this machine and clusters."""
