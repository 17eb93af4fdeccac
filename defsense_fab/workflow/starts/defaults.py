"""Defaults of a first device, in a module without heavy imports, because the help shows them."""

from __future__ import annotations

DEFAULT_PROCESS, DEFAULT_CORD, DEFAULT_CORDS = "fdm-tpu", "rubber-2mm", 3
#: Largest number of cords that can be proposed.
MAX_CORDS = 16
