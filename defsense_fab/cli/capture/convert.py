"""The command `defsense capture convert`: tracks in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ...workflow.sessions.options import ConversionOptions
from ..app import command
from ..output import OutputOptions, print_json, print_lines

_DEFAULTS = ConversionOptions()
_NO_OUTPUT = OutputOptions()

convert = command("convert", "defsense capture convert take.c3d tracks.csv")


@convert.default
def _convert(
    source: Annotated[Path, Parameter(name="FROM")],
    out: Annotated[Path, Parameter(name="TO")],
    /,
    *,
    options: Annotated[ConversionOptions, Parameter(name="*")] = _DEFAULTS,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Read tracks of markers and write them in another format.

    Formats are .csv, .npz, .parquet, .c3d and .trc. Positions are in mm; missing markers stay
    missing. Markers labeled tag_N or SUBJECT:tag_N become marker N, and others are left out.
    Without such labels, the numbers are those at the labels' ends if these differ, or else their
    order.

    Args:
        source: Tracks to read.
        out: Tracks to write.
    """
    from ...workflow.sessions.track_files import convert_tracks

    result = convert_tracks(source, out, options)
    count, share = len(result.tracks.ids), result.visible_share
    if output.json:
        print_json(
            {
                "frames": result.written.frames,
                "rate": result.written.rate,
                "gaps": result.written.gaps,
                "markers": count,
                "seen": share,
                "frame": result.frame,
                "notes": list(result.notes),
            }
        )
        return
    print_lines(
        [
            f"{result.written.summary}; {count} markers, {share:.0%} visible in"
            f" {len(result.tracks.time)} frames",
            *(f"note: {note}" for note in result.notes),
            f"frame: {result.frame}",
            f"Look at: {out}",
        ]
    )
