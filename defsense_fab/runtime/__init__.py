"""Run a device live: decode its signals, control other programs, show and record its surface."""
