"""Cameras: images from them, intrinsics, extrinsics, and their files."""
