"""What the page says of a built device, and where cameras fly, of numbers that are given."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.arrays import parse_points, format_point
from defsense_fab.report.guide.assembly.steps import GuideStep
from defsense_fab.report.guide.tables import GuideTable
from defsense_fab.studio.make.built_device import notes
from defsense_fab.studio.make.parts_scene import approach, fly
from defsense_fab.studio.make.built_device import state_words, step_words, table_words


def test_places_in_messages_are_read_back():
    point = np.array([1.26, -0.04, 120.0])
    (read,) = parse_points(f"it is thin near {format_point(point)}: it may print with gaps (0.3, twice)")
    assert read == pytest.approx([1.3, 0.0, 120.0])
    assert parse_points("nowhere") == []


def test_a_note_is_where_it_says_or_where_what_it_names_is():
    cord = SimpleNamespace(name="left", points=np.array([[0.0, 0, 0], [5, 5, 5], [9, 0, 0]]))
    layout = SimpleNamespace(sensors=[cord], warnings=("cord left is slack, by 2 %",))
    parts = {
        "1-top": SimpleNamespace(bounds=np.array([[0.0, 0, 0], [2, 2, 2]])),
        "2-back": SimpleNamespace(bounds=np.array([[4.0, 0, 0], [6, 2, 2]])),
    }
    manifest = SimpleNamespace(
        warnings=(
            "thin near (1.0, 2.0, 3.0)", "0 of 2 pins fit between 1-top and 2-back: align",
            "bonded cords are compressed", "cord left is slack, by 2 %",
        )
    )  # fmt: skip
    found = notes(manifest, layout, parts)
    assert len(found) == 4  # what both say is told once
    assert found[0].place.tolist() == [1.0, 2.0, 3.0]
    assert found[1].place.tolist() == [3.0, 1.0, 1.0]  # between the two
    assert found[2].place is None
    assert found[3].place.tolist() == [5.0, 5.0, 5.0]


def test_steps_and_tables_are_those_of_the_guide():
    step = GuideStep("Join a and b", ("Put in 2 x pin.", "x < y | z"))
    assert step_words(step, 3) == "### 3. Join a and b\n- Put in 2 x pin.\n- x &lt; y \\| z"
    narrow = GuideTable("t", ("item", "amount"), (("glue", "1"),))
    assert table_words(narrow) == "| item | amount |\n|---|---|\n| glue | 1 |"
    wide = GuideTable("t", tuple("abcdef"), (tuple("123456"), tuple("uvwxyz")))
    assert table_words(wide).splitlines()[:3] == ["| a | 1 | u |", "|---|---|---|", "| b | 2 | v |"]
    assert table_words(GuideTable("t", ("a",), ())) == "nothing"


def test_of_which_device_the_parts_are_is_told():
    assert "Nothing is built yet" in state_words(False, "load the body", None)
    assert "as it is now" in state_words(True, None, None)
    old = state_words(True, "optimize the cords", "the disk is full")
    assert "older device" in old
    assert "'optimize the cords' has still to be done" in old
    assert "The last build did not end: the disk is full" in old
    assert "`--copies 3` asked for" in state_words(True, None, None, "--copies 3")
    assert "it has changed (copies is 2), and" in state_words(
        True, "make the parts", None, "copies is 2"
    )


def test_a_camera_comes_from_outside_and_looks_at_the_place():
    middle, place = np.zeros(3), np.array([0.0, 0.0, 10.0])
    end = approach(place, middle, np.array([0.0, -100.0, 10.0]), 100.0)
    assert np.linalg.norm(end - place) == pytest.approx(45.0)
    assert end[2] > 10.0
    assert end[1] < 0.0
    assert np.isfinite(approach(middle, middle, middle, 100.0)).all()


class Client:
    def __init__(self):
        self.camera = SimpleNamespace(position=(0.0, -100.0, 0.0), look_at=(0.0, 0.0, 0.0))

    def atomic(self):
        import contextlib

        return contextlib.nullcontext()


def test_every_browser_flies():
    clients = {1: Client(), 2: Client()}
    server = SimpleNamespace(get_clients=lambda: clients)
    place = np.array([10.0, 0.0, 0.0])
    assert fly(server, place, np.zeros(3), 100.0, pause=0.0) == 2
    for client in clients.values():
        assert client.camera.look_at == pytest.approx((10.0, 0.0, 0.0))
        away = np.linalg.norm(np.array(client.camera.position) - place)
        assert away == pytest.approx(45.0)
