"""Check whether a sliced print contains its conductive traces as they were designed.

The beads of the conductive extruder become a network of resistors. A print that differs from its
design has findings: gaps, necks, bridges, stray beads, and beads of the wrong extruder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csgraph
from scipy.spatial import cKDTree

from ...core.arrays import Bool, Float, Int
from ...core.errors import FabricationError
from .bead_cells import CELL_LENGTH_MM, Cells, Contacts, cut_into_cells, find_contacts
from .conductor_network import (
    TERMINAL_REACH_MM,
    Neck,
    Resistivity,
    find_components,
    find_necks,
    find_nodes,
    solve_resistance,
)
from .gcode import Beads
from .traces import Places, Trace, find_arcs, find_terminal_arcs, locate, point_at

#: A cross-section below this share of the designed one is a neck.
NECK_SHARE = 0.6
#: Positions along one trace that touch although they are this many cross-sections apart: a bridge.
_SELF_DISTANCE = 4.0
_CLUSTER_GAP_MM = 2.0  # between beads of the wrong extruder that are reported together
_MIN_SHARE_INSIDE = 0.05  # of the conductive beads; fewer means that the traces are elsewhere
_MIN_STRAY_MM3 = 0.005  # less than a drop at the end of a bead


@dataclass(frozen=True)
class Finding:
    """Difference between a print and its design.

    Attributes:
        kind: `"gap"`, `"neck"`, `"bridge"`, `"stray"` or `"wrong-extruder"`.
        traces: Names of the traces concerned; none for stray beads.
        point: Place (3,), mm, in the print's frame.
        size: Length of a gap, mm; cross-section of a neck or area of contact of a bridge, mm^2;
            volume of beads that are stray or of the wrong extruder, mm^3.
    """

    kind: str
    traces: tuple[str, ...]
    point: Float
    size: float


@dataclass(frozen=True)
class TraceReport:
    """What a print contains of one trace.

    Attributes:
        name: Name of the trace.
        is_connected: Whether beads connect both terminals.
        length: Length of the center line between the terminals, mm.
        resistance: Resistance between the terminals at rest (R0), ohm; infinite if unconnected.
        neck_area: Narrowest cross-section, mm^2, from half a width beyond the terminals on.
        neck_point: Place (3,) of the narrowest cross-section, mm.
        volume: Deposited conductive volume, mm^3.
    """

    name: str
    is_connected: bool
    length: float
    resistance: float
    neck_area: float
    neck_point: Float
    volume: float


@dataclass(frozen=True)
class ConductorReport:
    """Result of a check.

    Attributes:
        traces: One report per trace.
        findings: Differences between print and design; none for a correct print.
        warnings: What the check assumed.
    """

    traces: tuple[TraceReport, ...]
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...] = ()


def check_traces(
    beads: Beads,
    traces: Sequence[Trace],
    tool: int,
    resistivity: Resistivity,
    neck_share: float = NECK_SHARE,
) -> ConductorReport:
    """Check the conductive beads of a print against its traces.

    Args:
        beads: Beads of the print.
        traces: Traces, in the print's frame (see `find_shift`).
        tool: Number of the conductive extruder, from 0.
        resistivity: Resistivity of the conductive filament, ohm mm.
        neck_share: Share of the designed cross-section below which a neck is a finding.

    Returns:
        Reports on the traces and the findings.

    Raises:
        FabricationError: The extruder deposits nothing, or nothing near the traces.
    """
    chosen = np.flatnonzero((beads.tool == tool) & beads.is_object)
    if not len(chosen):
        other = np.unique(beads.tool[beads.is_object]).tolist()
        raise FabricationError(
            f"extruder T{tool} deposits nothing in the object; extruders in use: {other}",
            code="no-conductive-extrusion",
            where=f"{beads.source}:{beads.line[-1] if len(beads) else 1}",
            action="Assign the conductive filament to the traces in the slicer",
            tools=other,
        )
    cells, joined = cut_into_cells(beads, chosen)
    contacts = find_contacts(cells, joined)
    margin = float(max(np.median(cells.height), np.median(cells.width) / 2))
    places = _assign(cells, traces, margin)
    if (places.trace >= 0).mean() < _MIN_SHARE_INSIDE:
        raise FabricationError(
            f"the beads of extruder T{tool} are not where the traces are",
            code="traces-misplaced",
            where=beads.source,
            action="Move the traces to the place where the slicer put the object",
        )
    reports, findings = [], []
    for k, trace in enumerate(traces):
        report, found = _check_trace(trace, cells, contacts, places, k, resistivity, neck_share)
        reports.append(report)
        findings += found
    findings += _find_bridges(cells, contacts, places, traces)
    findings += _find_wrong_extruder(beads, traces, tool)
    return ConductorReport(tuple(reports), tuple(findings), beads.warnings)


def _assign(cells: Cells, traces: Sequence[Trace], margin: float) -> Places:
    """Return where the cells are, with trace -1 for cells outside all traces."""
    places = locate(cells.center, traces, margin)
    width = np.array([t.width for t in traces])[places.trace]
    height = np.array([t.height for t in traces])[places.trace]
    inside = (places.side <= width / 2 + margin) & (places.rise <= height / 2 + margin)
    inside &= places.beyond <= margin
    places.trace[~inside] = -1
    return places


def _check_trace(
    trace: Trace,
    all_cells: Cells,
    all_contacts: Contacts,
    places: Places,
    index: int,
    resistivity: Resistivity,
    neck_share: float,
) -> tuple[TraceReport, list[Finding]]:
    """Return the report on one trace, and its gaps and necks."""
    mine = places.trace == index
    contacts = all_contacts.select(mine)
    cells, arc = all_cells.take(mine), places.arc[mine]
    low, high = find_terminal_arcs(trace)
    length = high - low
    component = find_components(len(cells), contacts.pair)
    first, last = arc <= low + TERMINAL_REACH_MM, arc >= high - TERMINAL_REACH_MM
    shared = np.intersect1d(component[first], component[last])
    volume = float((cells.section * cells.length).sum())
    if not len(shared):
        gaps = _find_gaps(trace, cells, component, arc, first, last)
        point = gaps[0].point if gaps else trace.points[0]
        return TraceReport(trace.name, False, length, np.inf, 0.0, point, volume), gaps
    sizes = [np.count_nonzero(component == c) for c in shared]
    main = component == shared[int(np.argmax(sizes))]
    whole = cells.take(main)
    nodes = find_nodes(whole, np.flatnonzero(mine)[main])
    resistance = solve_resistance(
        whole,
        contacts.select(main),
        nodes,
        resistivity,
        find_arcs(nodes.point, trace),
        (low, high),
    )
    window = max(6 * max(trace.width, trace.height), 10 * CELL_LENGTH_MM)
    # Beads turn around at the ends, where the contacts are.
    edge = min(trace.width / 2, length / 4)
    necks = find_necks(cells, contacts, arc, (low + edge, high - edge), window)
    narrowest = min(necks, key=lambda n: n.area)
    found = [
        Finding("neck", (trace.name,), n.point, n.area)
        for n in _select_necks(necks, neck_share * trace.area)
    ]
    return (
        TraceReport(trace.name, True, length, resistance, narrowest.area, narrowest.point, volume),
        found,
    )


def _select_necks(necks: Sequence[Neck], limit: float) -> list[Neck]:
    """Return the narrowest neck of each run of overlapping stretches that are too narrow."""
    selected: list[Neck] = []
    was_narrow = False
    for neck in necks:
        is_narrow = neck.area < limit
        if is_narrow and not was_narrow:
            selected.append(neck)
        elif is_narrow and neck.area < selected[-1].area:
            selected[-1] = neck
        was_narrow = is_narrow
    return selected


def _find_gaps(
    trace: Trace, cells: Cells, component: Int, arc: Float, first: Bool, last: Bool
) -> list[Finding]:
    """Return the gaps between the terminals of an unconnected trace.

    They are the steps of the path over pieces whose longest step is shortest.
    """
    low, high = find_terminal_arcs(trace)
    if not len(cells):
        return [Finding("gap", (trace.name,), point_at(trace, (low + high) / 2), high - low)]
    count = int(component.max()) + 1
    best: dict[tuple[int, int], tuple[float, Float]] = {}
    groups = [np.flatnonzero(component == c) for c in range(count)]
    # Terminals are pieces of their own, at distance zero of the cells in their reach.
    for node, mask, position in ((count, first, low), (count + 1, last, high)):
        point = point_at(trace, position)
        for c, group in enumerate(groups):
            if mask[group].any():
                best[c, node] = (1e-6, point)
            else:
                distance = float(np.abs(arc[group] - position).min())
                nearest = group[int(np.abs(arc[group] - position).argmin())]
                best[c, node] = (distance, (cells.center[nearest] + point) / 2)
    # Nearby strands of a trace that goes out and comes back are far apart along it.
    place = np.column_stack([cells.center, arc])
    trees = [cKDTree(place[group]) for group in groups]
    for a in range(count):
        for b in range(a + 1, count):
            distance, index = trees[b].query(place[groups[a]])
            i = int(distance.argmin())
            pair = cells.center[groups[a][i]], cells.center[groups[b][index[i]]]
            best[a, b] = (float(distance[i]) / np.sqrt(2), (pair[0] + pair[1]) / 2)
    keys = np.array(list(best))
    weight = np.array([value[0] for value in best.values()])
    graph = coo_array((weight, (keys[:, 0], keys[:, 1])), shape=(count + 2, count + 2))
    tree = csgraph.minimum_spanning_tree(graph.tocsr())
    _, before = csgraph.breadth_first_order(tree, count, directed=False)
    findings, node = [], count + 1
    while node != count:
        distance, point = best[min(node, before[node]), max(node, before[node])]
        if distance > 1e-5:
            size = max(distance - CELL_LENGTH_MM, 0.0)
            findings.append(Finding("gap", (trace.name,), point, size))
        node = int(before[node])
    return findings[::-1]


def _find_bridges(
    cells: Cells, contacts: Contacts, places: Places, traces: Sequence[Trace]
) -> list[Finding]:
    """Return contacts between traces, directly or over stray beads, and other stray beads."""
    names = [t.name for t in traces]
    i, j = contacts.pair.T
    a, b = places.trace[i], places.trace[j]
    reach = _SELF_DISTANCE * np.array([t.width + t.height for t in traces])
    far = np.abs(places.arc[i] - places.arc[j]) > reach[a]
    direct = (a >= 0) & (b >= 0) & ((a != b) | far)
    findings = []
    middle = (cells.center[i] + cells.center[j]) / 2
    for group in _cluster(middle, np.flatnonzero(direct)):
        concerned = tuple(names[k] for k in np.unique([a[group], b[group]]))
        findings.append(
            Finding(
                "bridge", concerned, middle[group].mean(axis=0), float(contacts.area[group].sum())
            )
        )
    stray = np.flatnonzero(places.trace < 0)
    if not len(stray):
        return findings
    number = np.full(len(cells), -1)
    number[stray] = np.arange(len(stray))
    inner = contacts.within(places.trace < 0)
    component = find_components(len(stray), number[inner.pair])
    touching = np.flatnonzero((a < 0) != (b < 0))
    outside = np.where(a[touching] < 0, i[touching], j[touching])
    member = np.where(a[touching] < 0, j[touching], i[touching])
    of_contact = component[number[outside]]
    for c in range(int(component.max()) + 1):
        group, on = stray[component == c], of_contact == c
        touched = np.unique(places.trace[member[on]])
        arcs = places.arc[member[on]]
        is_loop = len(touched) == 1 and np.ptp(arcs) > reach[touched[0]]
        volume = float((cells.section[group] * cells.length[group]).sum())
        point = cells.center[group].mean(axis=0)
        if len(touched) > 1 or is_loop:
            area = float(contacts.area[touching[on]].sum())
            findings.append(Finding("bridge", tuple(names[k] for k in touched), point, area))
        elif volume > _MIN_STRAY_MM3:
            findings.append(Finding("stray", (), point, volume))
    return findings


def _find_wrong_extruder(beads: Beads, traces: Sequence[Trace], tool: int) -> list[Finding]:
    """Return beads of other extruders in the traces."""
    points = np.concatenate([t.points for t in traces])
    reach = max(max(t.width, t.height) for t in traces)
    low, high = points.min(axis=0) - reach, points.max(axis=0) + reach
    near = (np.maximum(beads.start, beads.end) >= low).all(axis=1)
    near &= (np.minimum(beads.start, beads.end) <= high).all(axis=1)
    chosen = np.flatnonzero(near & (beads.tool != tool) & beads.is_object)
    if not len(chosen):
        return []
    cells, _ = cut_into_cells(beads, chosen)
    places = locate(cells.center, traces, 0.0)
    width = np.array([t.width for t in traces])[places.trace]
    height = np.array([t.height for t in traces])[places.trace]
    # The centers of beads of the body are half a width outside the trace.
    inside = (places.trace >= 0) & (places.beyond <= 0)
    inside &= places.side < width / 2 - 0.25 * cells.width
    inside &= places.rise < height / 2 - 0.25 * cells.height
    findings = []
    for k, trace in enumerate(traces):
        mine = np.flatnonzero(inside & (places.trace == k))
        for group in _cluster(cells.center, mine):
            volume = float((cells.section[group] * cells.length[group]).sum())
            point = cells.center[group].mean(axis=0)
            findings.append(Finding("wrong-extruder", (trace.name,), point, volume))
    return findings


def _cluster(points: Float, chosen: Int) -> list[Int]:
    """Return groups of chosen points that are close to each other."""
    if not len(chosen):
        return []
    pair = cKDTree(points[chosen]).query_pairs(_CLUSTER_GAP_MM, output_type="ndarray")
    label = find_components(len(chosen), pair.astype(np.int64))
    return [chosen[label == c] for c in range(int(label.max()) + 1)]
