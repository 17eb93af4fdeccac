"""Words on what is printed, in a font that comes with the libraries: systems have different ones,
or none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import build123d as bd


def lettering(words: str, size: float) -> Any:
    """The outlines of words, as a build123d sketch centred on the origin; `size` in mm."""
    import matplotlib

    font = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    middle = (bd.Align.CENTER, bd.Align.CENTER)
    return bd.Text(words, font_size=size, font_path=str(font), align=middle)
