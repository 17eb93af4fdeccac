"""Which searches a layout is chosen from, and further ones if no layout can be made."""

from __future__ import annotations

from ...core.curve import distinct_planes
from ...core.device.device import Device
from ...optimization.prediction.design_task import DesignTask
from ...optimization.refinement.refine import OptimizedLayout, evaluate_unchanged
from ...optimization.search.plane_directions import face_directions
from ...optimization.search.starting_layouts import FREE
from .layout_searches import Search, SearchRunner
from .stages import Report

# The fewer the cords, the less time a search takes, and the more its random choices matter.
_CORD_SEARCHES = 15  # searches times cords
_MIN_SEARCHES = 5
_MORE_SEARCHES = 4  # if no layout of the searches can be made


def default_searches(cords: int) -> int:
    """Return the default number of searches with different seeds, for a number of cords."""
    return max(_CORD_SEARCHES // cords, _MIN_SEARCHES)


def search_alternatives(
    device: Device,
    task: DesignTask,
    first: OptimizedLayout,
    report: Report,
    runner: SearchRunner,
) -> list[OptimizedLayout]:
    """Return the layout with its alternatives.

    They are the layout that the search started from, if it keeps the limits, and layouts of other
    seeds, of fewer planes, and of planes along the body's faces. Layouts of locked cords have none.
    """
    layouts = [first]
    if not is_searched(device):
        return layouts
    start = evaluate_unchanged(task.design, tuple(first.initial))
    layouts += [start] if start else []
    is_cut = device.cord.trace is None
    fewer = range(1, len(distinct_planes([s.plane for s in first.sensors])) if is_cut else 1)
    if not device.propose:  # without new cords, the planes are as many as those drawn
        fewer = fewer[len(distinct_planes([s.plane for s in device.sensors])) - 1 :][:1]
    count, kind = device.searches or default_searches(len(first.sensors)), task.design.decoder
    searches = [Search(kind, seed, device.planes) for seed in range(1, count)]
    searches += [Search(kind, 0, n) for n in fewer if device.planes is None or n < device.planes]
    has_free_planes = device.planes is None and any(s.free == FREE for s in device.sensors)
    if is_cut and (device.propose or has_free_planes):
        searches.append(Search(kind, 0, device.planes, face_directions(task.design.surface)))
    if device.searches is not None:  # simple layouts first, as they are the likeliest to be made
        searches = searches[::-1][: device.searches - 1]
    found = runner.run(searches, report)
    # Some have no room for the cords in so few planes.
    return [*layouts, *(layout for layout in found if isinstance(layout, OptimizedLayout))]


def is_searched(device: Device) -> bool:
    """Return whether a search may move or add cords."""
    return device.propose > 0 or any(s.free for s in device.sensors)


def search_more(
    device: Device, task: DesignTask, cords: int, report: Report, runner: SearchRunner
) -> list[OptimizedLayout]:
    """Return layouts of further searches, for a device none of whose layouts can be made."""
    kind = task.design.decoder
    first = max(device.searches or 0, default_searches(cords))
    searches = [Search(kind, first + k, device.planes) for k in range(_MORE_SEARCHES)]
    if device.cord.trace is None:
        searches.append(Search(kind, 0, device.planes, face_directions(task.design.surface)))
    report(0.9, "no layout can be made: searching for others")
    found = runner.run(searches, lambda _, text: report(0.9, text))
    return [layout for layout in found if isinstance(layout, OptimizedLayout)]
