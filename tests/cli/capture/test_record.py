"""The command `capture record`: its arguments, and sessions that cannot be resumed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from defsense_fab.capture.sessions import session as sessions
from defsense_fab.cli.main import parse, run_command
from defsense_fab.core.errors import CaptureError, DeviceError
from defsense_fab.core.markers import Markers
from defsense_fab.core.schema.options import changed_options
from defsense_fab.workflow.sessions.options import RecordOptions
from defsense_fab.workflow.sessions.recording import unit_name
from tests.support.errors import raises
from tests.support.places import BAR

RECORD = ["capture", "record", str(BAR)]


def parsed(*words):
    """Return the arguments of a command line by name."""
    return parse([*RECORD, *words])[1].arguments


@pytest.mark.parametrize(
    ("words", "cameras"),
    [
        (["--cameras", "0", "2", "--port", "COM3"], ("0", "2")),
        (["--cameras", "0", "--cameras", "2", "--port", "COM3"], ("0", "2")),
        (["--port", "twin", "--cameras", "twin:phone,cameras=3"], ("twin:phone,cameras=3",)),
        (["--port=none", "--cameras=none"], ("none",)),
    ],
)
def test_cameras_are_read_as_they_are(words, cameras):
    assert parsed(*words)["cameras"] == cameras


def test_options_have_the_defaults_of_their_record():
    arguments = parsed("--cameras", "0", "--port", "COM3")
    assert changed_options(arguments.get("options", RecordOptions())) == []


def test_options_are_read():
    words = ["--reference", "1500,2200", "--rounds", "3", "--rest=2.5", "--video", "--out", "s"]
    options = parsed("--cameras", "0", "--port", "COM3", *words)["options"]
    assert options == RecordOptions(
        reference=(1500.0, 2200.0), rounds=3, rest=2.5, video=True, out=Path("s")
    )


@pytest.mark.parametrize(
    ("kind", "code", "words"),
    [
        (DeviceError, "argument-missing", ["--cameras", "0"]),
        (DeviceError, "argument-missing", ["--port", "COM3"]),
        (CaptureError, "out-of-range", ["--cameras", "0", "--port", "COM3", "--rounds", "0"]),
        (CaptureError, "out-of-range", ["--cameras", "0", "--port", "COM3", "--reference", "-1"]),
    ],
)
def test_invalid_words_are_rejected(kind, code, words):
    with raises(kind, code):
        parsed(*words)


@pytest.mark.parametrize(
    ("cameras", "port", "code"),
    [
        ("none", "none", "nothing-to-record"),
        ("twin", "COM3", "twin-incomplete"),
        ("0", "twin", "twin-incomplete"),
    ],
)
def test_sources_must_fit_together(tags, cameras, port, code):
    with raises(DeviceError, code):
        run_command([*RECORD, "--cameras", cameras, "--port", port, "--markers", str(tags)])


@pytest.mark.parametrize(
    ("given", "port", "name"),
    [(None, "/dev/ttyUSB0", ""), (None, "twin", "twin-7"), ("third", "twin", "third")],
)
def test_seed_of_a_twin_names_the_unit(given, port, name):
    assert unit_name(given, ["twin:seed=7"], port) == name


@pytest.fixture
def session(tmp_path):
    """A session of the first unit of a bar, with three tags."""
    axes = np.tile(np.eye(3), (3, 1, 1))
    centers = np.array([[5.0, 0, 15], [5, 9, 15], [9, 3, 15]])
    markers = Markers("bar", "4X4_50", 6.0, np.arange(3), centers, axes, np.ones(3, bool))
    return sessions.create(
        tmp_path / "s",
        device="bar",
        steps=[sessions.PoseStep("rest", 1.0)],
        channels=("left",),
        reference=(1500.0,),
        calibration=None,
        markers=markers,
        unit="first",
        layout="abc",
    )


@pytest.fixture
def tags(session):
    return session.folder / "markers.json"


def test_session_is_not_resumed_with_another_unit(session, tags):
    assert (session.unit, session.layout) == ("first", "abc")
    words = ["--cameras", "none", "--port", "/dev/none", "--unit", "second"]
    with raises(CaptureError, "session-of-another-unit"):
        run_command([*RECORD, *words, "--out", str(session.folder), "--markers", str(tags)])


def test_number_of_reference_resistors_must_fit(session, tags, tmp_path):
    words = ["--cameras", "none", "--port", "/dev/none", "--reference", "1000,1000,1000,1000"]
    with raises(CaptureError, "resistance-count-differs", count=4):
        run_command([*RECORD, *words, "--out", str(tmp_path / "new"), "--markers", str(tags)])
    assert not (tmp_path / "new").exists()
