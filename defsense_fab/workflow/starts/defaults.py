"""What a first device is of where nothing is said; apart, since help tells it before more loads."""

from __future__ import annotations

PROCESS, CORD, CORDS = "fdm-tpu", "rubber-2mm", 3
#: That are to be found at most.
MOST_CORDS = 16
