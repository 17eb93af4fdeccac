"""What the guide says of each action."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from . import bench_words as bench
from . import joint_words as joint
from .actions import Action, Kind
from .words import Words

_SAID: Mapping[Kind, Callable[[Words, Action], list[str]]] = {
    Kind.PRINT: bench.print_parts,
    Kind.CAST: bench.cast_parts,
    Kind.TRY_PINS: bench.try_pins,
    Kind.CUT: bench.cut,
    Kind.CRIMP: bench.crimp,
    Kind.MARK: bench.mark,
    Kind.TRIM: bench.trim,
    Kind.DRY_FIT: joint.dry_fit,
    Kind.PINS: joint.pins,
    Kind.LAY: joint.lay,
    Kind.THREAD: bench.thread,
    Kind.STRETCH: joint.stretch,
    Kind.GLUE_END: joint.glue_end,
    Kind.SET_END: joint.set_end,
    Kind.WIRE: joint.wire,
    Kind.GLUE: joint.glue,
    Kind.SET: joint.set_glue,
    Kind.PULL: bench.pull,
    Kind.SEAT: bench.seat,
    Kind.MEASURE: bench.measure,
    Kind.CONNECT: bench.connect,
}


def sentences(words: Words, action: Action) -> tuple[str, ...]:
    """What to do, and what to look out for."""
    return tuple(_SAID[action.kind](words, action))
