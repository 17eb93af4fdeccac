"""Which of several devices built alike a session is of."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.capture.sessions import session as sessions
from defsense_fab.cli.main import main
from defsense_fab.core.markers import Markers
from defsense_fab.twin.live.capture_setup import CaptureOptions, unit_name
from tests.support.places import BAR


@pytest.mark.parametrize(
    ("given", "port", "name"),
    [(None, "/dev/ttyUSB0", ""), (None, "twin", "twin-7"), ("third", "twin", "third")],
)
def test_a_twin_of_another_seed_is_another_unit(given, port, name):
    options = CaptureOptions(("twin",), port, twin=(7, 2, "webcam"), unit=given)
    assert unit_name(options) == name


def test_a_session_does_not_go_on_with_another_unit(tmp_path, capsys):
    axes = np.tile(np.eye(3), (3, 1, 1))
    places = np.array([[5.0, 0, 15], [5, 9, 15], [9, 3, 15]])
    tags = Markers("bar", "4X4_50", 6.0, np.arange(3), places, axes, np.ones(3, bool))
    session = sessions.create(
        tmp_path / "s", device="bar", steps=[sessions.PoseStep("rest", 1.0)], channels=("left",),
        reference=(1500.0,), calibration=None, markers=tags, unit="first", layout="abc",
    )  # fmt: skip
    assert (session.unit, session.layout) == ("first", "abc")
    code = main(
        ["capture", "record", str(BAR), "--cameras", "none", "--port", "/dev/none", "--unit",
         "second", "--out", str(tmp_path / "s"), "--markers", str(tmp_path / "s" / "markers.json")]
    )  # fmt: skip
    assert code == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "is a session of the unit 'first', not of 'second'; choose another folder" in error
