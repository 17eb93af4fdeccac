"""Conductive traces in synthetic and sliced prints, intact and damaged."""

from __future__ import annotations

import shutil
import time
from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest

from defsense_fab.core.errors import FabricationError
from defsense_fab.geometry.printing.bead_cells import cut_into_cells, find_contacts
from defsense_fab.geometry.printing.conductor_network import Resistivity, find_necks
from defsense_fab.geometry.printing.conductors import check_traces
from defsense_fab.geometry.printing.gcode import Beads, find_shift, read_beads
from defsense_fab.geometry.printing.slicer_files import write_prusa_3mf
from defsense_fab.geometry.printing.slicer_settings import (
    TraceSettings,
    slice_with_prusa,
    write_prusa_settings,
)
from defsense_fab.geometry.printing.traces import Trace
from tests.support.gcode_edits import add_extrusion, remove_extrusion, swap_tool
from tests.support.trace_block import (
    HIGH,
    LOW,
    block_solids,
    block_traces,
    straight_traces,
    synthetic_gcode,
)

RHO = Resistivity(along=100.0, across=100.0, layers=100.0)
DAMAGE = Resistivity(along=100.0, across=150.0, layers=200.0)


def check_text(text, folder, traces):
    path = folder / "edited.gcode"
    path.write_text(text)
    return check_traces(read_beads(path), traces, 1, DAMAGE)


def summarize(report):
    return sorted((f.kind, f.traces) for f in report.findings)


@pytest.mark.parametrize("dialect", ["prusa", "cura", "bambu"])
def test_intact_synthetic_print_has_no_findings(tmp_path, dialect):
    path = tmp_path / "a.gcode"
    path.write_text(synthetic_gcode(dialect))
    report = check_traces(read_beads(path), straight_traces(), 1, RHO)
    assert report.findings == ()
    for trace in report.traces:
        assert trace.is_connected
        assert trace.length == pytest.approx(30)
        assert trace.volume == pytest.approx(12 * 0.08 * 30, rel=1e-3)
        assert trace.neck_area == pytest.approx(12 * 0.08, rel=0.01)
        assert trace.resistance == pytest.approx(100 * 30 / (12 * 0.08), rel=0.01)
    assert bool(report.warnings) == (dialect != "prusa")


def test_a_neck_of_a_stretch_without_beads_has_a_place(tmp_path):
    """The last of the stretches begins beyond the beads of the trace, which end at x = 40."""
    path = tmp_path / "a.gcode"
    path.write_text(synthetic_gcode())
    beads = read_beads(path)
    chosen = np.flatnonzero((beads.tool == 1) & beads.is_object)
    cells, joined = cut_into_cells(beads, chosen)
    arc = cells.center[:, 0] - 10
    necks = find_necks(cells, find_contacts(cells, joined), arc, (0.0, 60.0), 10.0)
    assert necks[-1].area == 0
    assert necks[-1].point[0] == pytest.approx(40, abs=1)


def test_resistance_is_that_of_few_beads_where_others_are_missing(tmp_path):
    """One bead of twelve over 6 mm: R = rho (24 / 12 + 6 / 1) / bead section, and spreading."""
    text = synthetic_gcode()
    for low, high in (((17, 9, 0), (23, 9.8, 2)), ((17, 10.2, 0), (23, 11, 2))):
        text = remove_extrusion(text, 1, low, high)
    text = remove_extrusion(text, 1, (17, 9.8, 0.5), (23, 10.2, 2))
    report = check_text(text, tmp_path, straight_traces())
    assert summarize(report) == [("neck", ("lower",))]
    lower = report.traces[0]
    assert lower.neck_area == pytest.approx(0.08, rel=0.02)
    bare = 100 / 0.08 * (24 / 12 + 6)
    assert bare < lower.resistance < 1.15 * bare
    assert report.traces[1].resistance == pytest.approx(3125, rel=0.01)


def test_terminals_within_a_trace_shorten_it(tmp_path):
    path = tmp_path / "a.gcode"
    path.write_text(synthetic_gcode())
    points = straight_traces()[0].points
    terminals = np.array([[15, 10, 0.6], [35, 10, 0.6]])
    traces = (Trace("t", points, 1.2, 0.8, terminals), straight_traces()[1])
    report = check_traces(read_beads(path), traces, 1, RHO)
    assert report.traces[0].length == pytest.approx(20, abs=0.05)
    assert report.traces[0].resistance == pytest.approx(100 * 20 / 0.96, rel=0.02)


SYNTHETIC = {
    "gap": lambda t: remove_extrusion(t, 1, (24, 9, 0), (25.5, 11, 2)),
    "two gaps": lambda t: remove_extrusion(
        remove_extrusion(t, 1, (24, 9, 0), (25.5, 11, 2)), 1, (32, 9, 0), (33.5, 11, 2)
    ),
    "missing end": lambda t: remove_extrusion(t, 1, (38, 9, 0), (41, 11, 2)),
    "bridge": lambda t: add_extrusion(t, 1, (20, 10.4), (20, 13.6), 0.6),
    "stray": lambda t: add_extrusion(t, 1, (20, 11.6), (30, 11.6), 0.6),
    "wrong extruder": lambda t: swap_tool(t, 1, 0, (24, 9, 0), (25.5, 11, 2)),
}
EXPECTED = {
    "gap": [("gap", ("lower",), (24.75, 10), 1.5)],
    "two gaps": [
        ("gap", ("lower",), (24.75, 10), 1.5),
        ("gap", ("lower",), (32.75, 10), 1.5),
    ],
    "missing end": [("gap", ("lower",), (39, 10), 2.0)],
    "bridge": [("bridge", ("lower", "upper"), (20, 12), None)],
    "stray": [("stray", (), (25, 11.6), 0.08 * 10)],
    "wrong extruder": [
        ("gap", ("lower",), (24.75, 10), 1.5),
        ("wrong-extruder", ("lower",), (24.75, 10), 1.5 * 12 * 0.08),
    ],
}


@pytest.mark.parametrize("name", SYNTHETIC)
def test_damage_of_a_synthetic_print_is_found(tmp_path, name):
    report = check_text(SYNTHETIC[name](synthetic_gcode()), tmp_path, straight_traces())
    assert summarize(report) == sorted((kind, traces) for kind, traces, *_ in EXPECTED[name])
    found = sorted(report.findings, key=lambda f: (f.kind, f.point[0]))
    for finding, (_, _, point, size) in zip(found, EXPECTED[name], strict=True):
        assert np.linalg.norm(finding.point[:2] - point) < 0.7
        if size is not None:
            assert finding.size == pytest.approx(size, rel=0.2, abs=0.25)
    assert report.traces[0].is_connected == (name in ("bridge", "stray"))
    assert report.traces[1].is_connected


def test_legs_of_one_trace_that_touch_are_a_bridge(tmp_path):
    path = tmp_path / "a.gcode"
    line = np.array([[10, 10, 0.6], [40, 10, 0.6], [40, 14, 0.6], [10, 14, 0.6]], float)
    text = synthetic_gcode()
    for z in (0.4, 0.6, 0.8, 1.0):
        for x in (39.6, 40.0, 40.4):
            text = add_extrusion(text, 1, (x, 10), (x, 14), z)
    path.write_text(text)
    traces = (Trace("hairpin", line, 1.2, 0.8),)
    # Beads of the body fill the space between the legs, also where they are joined.
    intact = [("wrong-extruder", ("hairpin",))]
    assert summarize(check_traces(read_beads(path), traces, 1, RHO)) == intact
    path.write_text(add_extrusion(text, 1, (20, 10.4), (20, 13.6), 0.6))
    report = check_traces(read_beads(path), traces, 1, RHO)
    assert summarize(report) == [("bridge", ("hairpin",)), *intact]


def test_extruder_without_beads_is_an_error(tmp_path):
    path = tmp_path / "a.gcode"
    path.write_text(synthetic_gcode())
    with pytest.raises(FabricationError) as error:
        check_traces(read_beads(path), straight_traces(), 2, RHO)
    assert error.value.code == "no-conductive-extrusion"
    assert error.value.data["tools"] == [0, 1]


def test_traces_elsewhere_are_an_error_and_the_shift_is_found(tmp_path):
    path = tmp_path / "a.gcode"
    path.write_text(synthetic_gcode())
    beads, shift = read_beads(path), np.array([100.0, -20, 0])
    moved = [t.move(shift) for t in straight_traces()]
    with pytest.raises(FabricationError) as error:
        check_traces(beads, moved, 1, RHO)
    assert error.value.code == "traces-misplaced"
    back = find_shift(beads, np.array([5, 8, 0]) + shift, np.array([45, 16, 1.4]) + shift)
    assert back == pytest.approx(-shift, abs=1e-6)
    assert check_traces(beads, [t.move(back) for t in moved], 1, RHO).findings == ()


def long_meander(legs=10, length=80.0, pitch=3.0):
    """Return a meander as a trace and as beads, 3 wide and 4 high, with short segments."""
    corners = [
        (x, pitch * k) for k in range(legs) for x in ((0, length) if k % 2 == 0 else (length, 0))
    ]
    line = np.array([(x, y, 0.4) for x, y in corners], float)
    start, end = [], []
    for layer in range(4):
        for offset in (-0.4, 0.0, 0.4):
            path = []
            for (x, y, _), (u, v, _) in pairwise(line):
                count = max(int(np.hypot(u - x, v - y) / 0.15), 1)
                share = np.linspace(0, 1, count + 1)[:, None]
                path.append(np.array([x, y]) + share * np.array([u - x, v - y]))
            center = np.concatenate(path)
            outward = np.where(center[:, :1] > length / 2, 1.0, -1.0) * [offset, 0]
            leg = np.round(center[:, 1:] / pitch) % 2
            shift = np.concatenate([np.zeros_like(leg), offset * (1 - 2 * leg)], axis=1)
            turning = np.abs(center[:, 1] / pitch - np.round(center[:, 1] / pitch)) > 1e-9
            center = center + np.where(turning[:, None], outward, shift)
            z = np.full((len(center), 1), 0.1 + 0.2 * layer)
            center = np.concatenate([center, z], axis=1)
            start.append(center[:-1])
            end.append(center[1:])
    start, end = np.concatenate(start), np.concatenate(end)
    size = np.linalg.norm(end - start, axis=1)
    kept = size > 1e-6
    start, end, size = start[kept], end[kept], size[kept]
    n = len(size)
    ones = np.ones(n, np.int64)
    beads = Beads(start, end, np.full(n, 0.443), np.full(n, 0.2), 0.08 * size, ones, 0 * ones, ones)
    return Trace("meander", line, 1.2, 0.8), beads


def test_a_gap_is_placed_along_the_trace():
    """The legs on both sides of the gap are nearer to each other than the gap is wide."""
    trace, beads = long_meander(legs=2, length=40.0)
    middle = (beads.start + beads.end) / 2
    kept = (middle[:, 1] > 1.5) | (np.abs(middle[:, 0] - 18) > 3)
    arrays = {f.name: getattr(beads, f.name) for f in fields(beads)}
    damaged = Beads(**{k: v[kept] if isinstance(v, np.ndarray) else v for k, v in arrays.items()})
    (gap,) = check_traces(damaged, [trace], 1, RHO).findings
    assert gap.kind == "gap"
    assert gap.point == pytest.approx([18, 0, 0.4], abs=0.5)
    assert gap.size == pytest.approx(6, abs=0.5)


@pytest.mark.slow
def test_long_traces_take_seconds():
    trace, beads = long_meander()
    assert len(beads) > 60_000
    started_at = time.process_time()
    report = check_traces(beads, [trace], 1, RHO)
    assert time.process_time() - started_at < 20
    assert report.findings == ()
    expected = 100 * report.traces[0].length / 0.96
    assert report.traces[0].resistance == pytest.approx(expected, rel=0.05)


def test_cells_keep_length_and_volume():
    beads = long_meander(2, 10.0)[1]
    cells, joined = cut_into_cells(beads, np.arange(len(beads)))
    assert cells.length.sum() == pytest.approx(beads.length.sum())
    assert (cells.section * cells.length).sum() == pytest.approx(beads.volume.sum())
    assert len(joined) <= len(cells) - 12


@pytest.fixture(scope="module")
def sliced(tmp_path_factory):
    """G-code of the block with two traces, without and with a wipe tower."""
    if shutil.which("prusa-slicer") is None:
        pytest.skip("prusa-slicer is not installed")
    folder = tmp_path_factory.mktemp("sliced")
    write_prusa_3mf(block_solids(), folder / "block.3mf", "block")
    texts = []
    for has_tower in (False, True):
        write_prusa_settings(TraceSettings(has_tower=has_tower), folder / "two.ini")
        slice_with_prusa(folder / "block.3mf", folder / "two.ini", folder / "block.gcode")
        texts.append((folder / "block.gcode").read_text())
    return texts


@pytest.mark.slow
@pytest.mark.parametrize("has_tower", [False, True])
def test_sliced_block_has_no_findings(sliced, tmp_path, has_tower):
    path = tmp_path / "block.gcode"
    path.write_text(sliced[has_tower])
    beads = read_beads(path)
    assert find_shift(beads, LOW, HIGH) == pytest.approx([0, 0, 0], abs=0.01)
    report = check_traces(beads, block_traces(), 1, RHO)
    assert report.findings == report.warnings == ()
    for result, trace in zip(report.traces, block_traces(), strict=True):
        assert result.is_connected
        assert 0.9 < result.resistance * trace.area / (100 * result.length) < 1.3
        assert 0.75 < result.neck_area / trace.area < 1.05
        assert 0.9 < result.volume / (trace.area * result.length) < 1.05


#: Box of all heights around x, and y of the trace.
def stretch(y, x, length=1.5, z=(0, 10)):
    return (x - length / 2, y - 3, z[0]), (x + length / 2, y + 3, z[1])


CURVED = {x: 96 + 3 * np.sin(2 * np.pi * (x - 74) / 52) for x in (75, 84, 100, 115)}
DAMAGES = {
    "gap in curved": (
        lambda t: remove_extrusion(t, 1, *stretch(CURVED[100], 100)),
        [("gap", "curved", 100)],
    ),
    "gap in rising": (
        lambda t: remove_extrusion(t, 1, *stretch(104, 90)),
        [("gap", "rising", 90)],
    ),
    "missing start": (
        lambda t: remove_extrusion(t, 1, *stretch(CURVED[75], 74.5, 4.0)),
        [("gap", "curved", 75.2)],
    ),
    "neck in curved": (
        lambda t: remove_extrusion(t, 1, *stretch(CURVED[115], 115, z=(2.9, 10))),
        [("neck", "curved", 115)],
    ),
    "neck in rising": (
        lambda t: remove_extrusion(t, 1, (109.2, 103.8, 0), (110.8, 105, 10)),
        [("neck", "rising", 110)],
    ),
    "bridge low": (
        lambda t: add_extrusion(t, 1, (84, 99), (84, 103.8), 3.0),
        [("bridge", "curved rising", 84)],
    ),
    "bridge high": (
        lambda t: add_extrusion(t, 1, (88, 98.8), (88, 103.8), 3.2),
        [("bridge", "curved rising", 88)],
    ),
    "wrong extruder in curved": (
        lambda t: swap_tool(t, 1, 0, *stretch(CURVED[100], 100)),
        [("gap", "curved", 100), ("wrong-extruder", "curved", 100)],
    ),
    "wrong extruder in rising": (
        lambda t: swap_tool(t, 1, 0, *stretch(104, 100)),
        [("gap", "rising", 100), ("wrong-extruder", "rising", 100)],
    ),
    "stray": (
        lambda t: add_extrusion(t, 1, (110, 100), (116, 100), 3.0),
        [("stray", "", 113)],
    ),
    "gap and bridge": (
        lambda t: add_extrusion(
            remove_extrusion(t, 1, *stretch(104, 110)), 1, (84, 99), (84, 103.8), 3.0
        ),
        [("bridge", "curved rising", 84), ("gap", "rising", 110)],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", DAMAGES)
def test_damage_of_a_sliced_block_is_found(sliced, tmp_path, name):
    damage, expected = DAMAGES[name]
    report = check_text(damage(sliced[0]), tmp_path, block_traces())
    found = sorted((f.kind, " ".join(f.traces), f.point[0]) for f in report.findings)
    assert [f[:2] for f in found] == [e[:2] for e in expected]
    assert [f[2] for f in found] == pytest.approx([e[2] for e in expected], abs=1.0)
