"""Texts of a built device, and the flight of cameras, computed from given numbers."""

from __future__ import annotations

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.studio.make.make_mode import BuildState, state_text, step_text, table_text
from defsense_fab.studio.make.parts_scene import fly_to, view_position
from defsense_fab.workflow.fabrication.assembly_guide import GuideTable


def test_a_step_has_a_heading_and_a_list():
    step = SimpleNamespace(title="Join a and b", lines=("Put in 2 x pin.", "x < y | z"))
    assert step_text(step, 3) == "### 3. Join a and b\n- Put in 2 x pin.\n- x &lt; y \\| z"


def test_wide_tables_are_transposed():
    narrow = GuideTable("t", ("item", "amount"), (("glue", "1"),))
    assert table_text(narrow) == "| item | amount |\n| --- | --- |\n| glue | 1 |"
    wide = GuideTable("t", tuple("abcdef"), (tuple("123456"), tuple("uvwxyz")))
    assert table_text(wide).splitlines()[:3] == [
        "| a | 1 | u |",
        "| --- | --- | --- |",
        "| b | 2 | v |",
    ]
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
            outdated_stage="optimize the layout",
            error="the disk is <full>",
            changes="copies is 2",
        )
    )
    assert "'optimize the layout'" in text
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
