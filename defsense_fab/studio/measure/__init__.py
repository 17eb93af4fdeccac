"""The mode that calibrates, records, trains and runs the finished device."""
