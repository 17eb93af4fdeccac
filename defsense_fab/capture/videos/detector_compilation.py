"""The tag detector's machine code: made on its first use on a computer, which takes a while."""

from __future__ import annotations

from collections.abc import Callable

from ...core.camera import Camera
from ...core.machine.compiled import is_compiled
from ..tags import edge_fit
from ..tags.detection import Detector
from ..tags.tag_patterns import Dictionary

COMPILING = "compiling the tag detector, once on this computer: some 20 s"


def compile_detector(camera: Camera, tags: Dictionary, tell: Callable[[str], None]) -> None:
    """Compile it, before what must not wait for it, where that was not done before, and `tell`."""
    if tell_of_compilation(tell):
        Detector(camera, tags)


def tell_of_compilation(tell: Callable[[str], None]) -> bool:
    """`tell` where the next detector will have to be compiled first; whether it will."""
    due = not is_compiled(edge_fit)
    if due:
        tell(COMPILING)
    return due
