"""Experiments with devices: built layouts, recorded and tested units, pictures of them."""
