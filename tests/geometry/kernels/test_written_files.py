"""Written files: the same parts give the same bytes, and a full disk is a system error."""

from __future__ import annotations

import errno
from pathlib import Path

import build123d as bd
import numpy as np
import pytest

from defsense_fab.geometry.kernels import occ, triangle_kernel
from defsense_fab.geometry.printing.export import write_3mf, write_stl
from tests.conftest import box_surface


def test_step_files_depend_on_neither_time_nor_earlier_files(tmp_path):
    solid = bd.Box(1, 2, 3).solids()[0].wrapped
    one, again, whole = (tmp_path / name for name in ("one.step", "again.step", "whole.step"))
    occ.write_step(solid, one, "x")
    occ.write_assembly({"a": solid, "b": solid}, whole, "x")
    first = whole.read_bytes()
    occ.write_step(solid, again, "x")
    occ.write_assembly({"a": solid, "b": solid}, whole, "x")
    assert one.read_bytes() == again.read_bytes()
    assert first == whole.read_bytes()
    assert b"'1980-01-01T00:00:00'" in first
    assert first.count(b"NEXT_ASSEMBLY_USAGE_OCCURRENCE('1'") == 1
    assert first.count(b"NEXT_ASSEMBLY_USAGE_OCCURRENCE('2'") == 1
    assert len(occ.read_step(whole)) == 2


@pytest.mark.parametrize(
    "name",
    ["Würfel", "日本-é", "😀ä", "日" * 30, "я" * 40, *("a" * n + "ééé日" for n in range(56, 66))],
    ids=range(15),
)
def test_names_in_step_files_round_trip(tmp_path, name):
    path = tmp_path / "named.step"
    solids = {f"{name}-{k}": bd.Box(1, 2, k).solids()[0].wrapped for k in (1, 2)}
    occ.write_assembly(solids, path, name)
    assert path.read_bytes().isascii()
    shape = bd.import_step(path)
    assert [shape.label, *(c.label for c in shape.children)] == [name, f"{name}-1", f"{name}-2"]


@pytest.mark.parametrize("away", [0.0, 8000.0])
def test_faces_that_meet_stay_apart_in_single_precision(away):
    box = triangle_kernel.to_manifold(box_surface([away, 0, 0], [away + 10, 10, 10]), "box")
    face = np.array([1.0, 0, 0]), away + 10
    surface = triangle_kernel.to_printable_surface(box, "box", [face])
    assert 0 < away + 10 - surface.bounds[1, 0] < 1e-3


def test_3mf_files_have_no_random_numbers(tmp_path):
    boxes = {n: box_surface(np.zeros(3), np.full(3, size)) for n, size in (("a", 5.0), ("b", 7.0))}
    for together in (True, False):
        files = [tmp_path / f"{k}.3mf" for k in range(2)]
        for path in files:
            write_3mf(boxes, path, "box", together)
        assert files[0].read_bytes() == files[1].read_bytes()


FULL = Path("/dev/full")
SURFACE = box_surface([0, 0, 0], [10, 20, 30])


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full here")
@pytest.mark.parametrize(
    "write",
    [
        lambda: write_stl(SURFACE, FULL),
        lambda: write_3mf({"box": SURFACE}, FULL, "box"),
        lambda: occ.write_step(bd.Box(10, 20, 30).solid().wrapped, FULL, "box"),
        lambda: occ.write_assembly({"box": bd.Box(1, 2, 3).solid().wrapped}, FULL, "box"),
    ],
    ids=["stl", "3mf", "step", "assembly"],
)
def test_full_disk_is_a_system_error(write):
    with pytest.raises(OSError) as caught:
        write()
    assert caught.value.errno == errno.ENOSPC
