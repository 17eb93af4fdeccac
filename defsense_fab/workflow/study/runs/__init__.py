"""Runs of a study: planning, log, batches, and clusters."""
