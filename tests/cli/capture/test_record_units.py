"""Units of a device: sessions belong to one unit."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.capture.sessions import session as sessions
from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import CaptureError
from defsense_fab.core.markers import Markers
from defsense_fab.twin.live.capture_setup import CaptureOptions, unit_name
from tests.support.errors import raises
from tests.support.places import BAR


@pytest.mark.parametrize(
    ("given", "port", "name"),
    [(None, "/dev/ttyUSB0", ""), (None, "twin", "twin-7"), ("third", "twin", "third")],
)
def test_seed_of_a_twin_names_the_unit(given, port, name):
    options = CaptureOptions(("twin",), port, twin=(7, 2, "webcam"), unit=given)
    assert unit_name(options) == name


def test_session_is_not_resumed_with_another_unit(tmp_path):
    axes = np.tile(np.eye(3), (3, 1, 1))
    places = np.array([[5.0, 0, 15], [5, 9, 15], [9, 3, 15]])
    tags = Markers("bar", "4X4_50", 6.0, np.arange(3), places, axes, np.ones(3, bool))
    session = sessions.create(
        tmp_path / "s", device="bar", steps=[sessions.PoseStep("rest", 1.0)], channels=("left",),
        reference=(1500.0,), calibration=None, markers=tags, unit="first", layout="abc",
    )  # fmt: skip
    assert (session.unit, session.layout) == ("first", "abc")
    words = ["capture", "record", str(BAR), "--cameras", "none", "--port", "/dev/none"]
    words += ["--unit", "second", "--out", str(tmp_path / "s")]
    words += ["--markers", str(tmp_path / "s" / "markers.json")]
    with raises(CaptureError, "session-of-another-unit"):
        run_command(words)
