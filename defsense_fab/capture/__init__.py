"""From the read-out board to recordings: ports, clocks, frames, files."""
