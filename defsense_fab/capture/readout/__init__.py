"""Samples of the read-out board: ports, reader, recordings, replay."""
