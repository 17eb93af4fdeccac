"""Take another of the layouts that an earlier search reached, without a search."""

from __future__ import annotations

from dataclasses import replace

from ...core.device.device import Device
from ...core.errors import LayoutError
from ...optimization.prediction.choose_layout import offered_layouts, prefer_layout
from ...optimization.prediction.design_task import DesignTask
from ...optimization.refinement.refine import OptimizedLayout, evaluate_unchanged
from ...store.layout import LayoutRecord
from .continued_layout import SearchedLayouts


def take_offer(
    device: Device, task: DesignTask, searched: SearchedLayouts
) -> tuple[int, OptimizedLayout]:
    """Return the layout with the number of parts of `[design] parts`, or the default one.

    Args:
        device: The device.
        task: Its design task, with the decoder of the search.
        searched: The layouts of an earlier build.

    Returns:
        The layout, and its index in these layouts.

    Raises:
        LayoutError: No layout with so many parts is offered, or it no longer keeps its limits.
    """
    tried = searched.record.weighed
    taken = prefer_layout(tried, device.prefer, device.parts)
    index = next((k for k, record in enumerate(tried) if record is taken), None)
    if index is None:
        offers = [(t.parts, t.built) for t in offered_layouts(tried, device.prefer)]
        texts = (f"{parts} ({error:.2f} mm)" for parts, error in offers)
        raise LayoutError(
            f"no layout with {device.parts} parts is offered",
            code="parts-not-offered",
            where=device.source / "device.toml",
            action=f"Use one of: {', '.join(texts)}; or search again with --search",
            parts=device.parts,
            offered=[parts for parts, _ in offers],
        )
    layout = evaluate_unchanged(task.design, searched.cords[index])
    if layout is None:
        raise LayoutError(
            "the layout no longer keeps its limits",
            code="layout-outdated",
            where=device.source,
            action="Search again with --search",
        )
    return index, layout


def keep_search(record: LayoutRecord, searched: SearchedLayouts, index: int) -> LayoutRecord:
    """Return the record of a layout that was taken, with what its search has left.

    Args:
        record: The layout, as if it alone had been reached.
        searched: The layouts of the earlier build.
        index: Index of the layout in these.
    """
    before = searched.record
    weighed = (replace(w, chosen=k == index) for k, w in enumerate(before.weighed))
    return replace(
        record,
        weighed=tuple(weighed),
        initial=before.initial,
        drawn=before.drawn,
        starts=before.starts,
        repaired=before.repaired,
        continued=before.continued,
    )
