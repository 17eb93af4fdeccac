"""Bounds that `[fabrication]` in `device.toml` and the options of a build share."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

#: Number of devices on the plates.
Copies = Annotated[int, Meta(ge=1, le=100)]
#: Width, depth or height of a printer's bed, mm.
BedSize = Annotated[float, Meta(ge=30, le=5000)]
