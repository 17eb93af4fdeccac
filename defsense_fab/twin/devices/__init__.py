"""A built device as a twin: its fields, built units, markers and cameras' places."""
