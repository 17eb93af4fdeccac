"""How much memory a file of tracks may ask for.

Tracks are a table of frames by markers, in which a file may leave out what was not seen: a damaged
or hostile one of some kB, every row of which names another frame and another marker, would fill all
memory there is. So what is read may take at most 64 MB and a hundred times the size of the file: in
CSV a marker then has to be seen in about every hundredth frame.
"""

from __future__ import annotations

from pathlib import Path

from ...core.errors import CaptureError

_FREE, _TIMES = 64_000_000, 100  # bytes; the size of the file
#: Bytes of a marker in a frame: its place and its standard deviations.
CELL = 48


def check_size(path: Path, needed: int) -> None:
    """Raises CaptureError where so many bytes of memory are out of all proportion to the file."""
    size = path.stat().st_size
    if needed > _FREE + _TIMES * size:
        raise CaptureError(
            f"{path}: its tracks would take {needed / 1e6:.0f} MB of memory, out of all proportion"
            f" to a file of {size / 1e6:.3g} MB; check its numbers of frames and markers",
            code="tracks-too-large",
        )
