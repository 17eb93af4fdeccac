"""Datasets of recordings, and checks that find problems in them."""
