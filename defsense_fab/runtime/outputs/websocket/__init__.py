"""Frames as JSON over a WebSocket, with a page that shows them."""
