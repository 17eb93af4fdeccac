"""Texts of a built device, and the flight of cameras, computed from given numbers."""

from __future__ import annotations

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.arrays import format_point, parse_points
from defsense_fab.report.guide.assembly.steps import GuideStep
from defsense_fab.report.guide.tables import GuideTable
from defsense_fab.studio.make.built_device import (
    BuildState,
    locate_notes,
    state_text,
    step_text,
    table_text,
)
from defsense_fab.studio.make.parts_scene import fly_to, view_position


def test_points_in_texts_are_read_back():
    point = np.array([1.26, -0.04, 120.0])
    (read,) = parse_points(f"thin near {format_point(point)}: may print with gaps (0.3, twice)")
    assert read == pytest.approx([1.3, 0.0, 120.0])
    assert parse_points("nowhere") == []


def test_a_note_is_at_its_point_or_at_the_parts_that_it_names():
    cord = SimpleNamespace(name="left", points=np.array([[0.0, 0, 0], [5, 5, 5], [9, 0, 0]]))
    layout = SimpleNamespace(sensors=[cord], warnings=("cord left is slack, by 2 %",))
    parts = {
        "1-top": SimpleNamespace(bounds=np.array([[0.0, 0, 0], [2, 2, 2]])),
        "2-back": SimpleNamespace(bounds=np.array([[4.0, 0, 0], [6, 2, 2]])),
    }
    manifest = SimpleNamespace(
        warnings=(
            "thin near (1.0, 2.0, 3.0)",
            "0 of 2 pins fit between 1-top and 2-back: align",
            "bonded cords are compressed",
            "cord left is slack, by 2 %",
        )
    )
    notes = locate_notes(manifest, layout, parts)
    assert len(notes) == 4  # a warning of both is listed once
    assert notes[0].point.tolist() == [1.0, 2.0, 3.0]
    assert notes[1].point.tolist() == [3.0, 1.0, 1.0]  # between the two parts
    assert notes[2].point is None
    assert notes[3].point.tolist() == [5.0, 5.0, 5.0]


def test_a_step_has_a_heading_and_a_list():
    step = GuideStep("Join a and b", ("Put in 2 x pin.", "x < y | z"))
    assert step_text(step, 3) == "### 3. Join a and b\n- Put in 2 x pin.\n- x &lt; y \\| z"


def test_wide_tables_are_transposed():
    narrow = GuideTable("t", ("item", "amount"), (("glue", "1"),))
    assert table_text(narrow) == "| item | amount |\n|---|---|\n| glue | 1 |"
    wide = GuideTable("t", tuple("abcdef"), (tuple("123456"), tuple("uvwxyz")))
    assert table_text(wide).splitlines()[:3] == ["| a | 1 | u |", "|---|---|---|", "| b | 2 | v |"]
    assert "|" not in table_text(GuideTable("t", ("a",), ()))


@pytest.mark.parametrize(
    ("state", "code"),
    [
        (BuildState(is_built=False, outdated_stage="load the body"), "not-built"),
        (BuildState(is_built=True), "up-to-date"),
        (BuildState(is_built=True, options="--copies 3"), "other-options"),
        (BuildState(is_built=True, outdated_stage="make the parts"), "outdated"),
    ],
)
def test_the_state_of_the_parts_has_a_code(state, code):
    assert state.code == code
    assert state_text(state)


def test_the_state_text_has_the_stage_the_changes_and_the_error():
    text = state_text(
        BuildState(
            is_built=True,
            outdated_stage="optimize the cords",
            error="the disk is <full>",
            changes="copies is 2",
        )
    )
    assert "'optimize the cords'" in text
    assert "the disk is &lt;full&gt;" in text
    assert "(copies is 2)" in text
    assert "`--copies 3`" in state_text(BuildState(is_built=True, options="--copies 3"))


def test_a_camera_looks_at_the_point_from_outside():
    middle, target = np.zeros(3), np.array([0.0, 0.0, 10.0])
    position = view_position(target, middle, np.array([0.0, -100.0, 10.0]), 100.0)
    assert np.linalg.norm(position - target) == pytest.approx(45.0)
    assert position[2] > 10.0
    assert position[1] < 0.0
    assert np.isfinite(view_position(middle, middle, middle, 100.0)).all()


class Client:
    """A browser with a camera."""

    def __init__(self):
        self.camera = SimpleNamespace(position=(0.0, -100.0, 0.0), look_at=(0.0, 0.0, 0.0))

    def atomic(self):
        return contextlib.nullcontext()


def test_the_cameras_of_all_browsers_fly():
    clients = {1: Client(), 2: Client()}
    server = SimpleNamespace(get_clients=lambda: clients)
    target = np.array([10.0, 0.0, 0.0])
    assert fly_to(server, target, np.zeros(3), 100.0, frame_s=0.0) == 2
    for client in clients.values():
        assert client.camera.look_at == pytest.approx((10.0, 0.0, 0.0))
        distance = np.linalg.norm(np.array(client.camera.position) - target)
        assert distance == pytest.approx(45.0)
