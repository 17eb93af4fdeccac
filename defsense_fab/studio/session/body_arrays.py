"""A surface as arrays for the page."""

from __future__ import annotations

from ...workflow.view import feature_edges as feature_edges
from ...workflow.view import surface_arrays as surface_arrays
