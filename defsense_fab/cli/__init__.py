"""Command line interface: one folder per task, one module per group of commands."""
