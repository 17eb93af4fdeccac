"""The wiring of a device: connections, their drawing, and their file for WireViz."""
