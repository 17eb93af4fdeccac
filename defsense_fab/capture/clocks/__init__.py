"""Synchronization of the clocks of read-out boards, cameras and the host."""
