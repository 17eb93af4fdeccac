"""Sessions before rendered cameras, recorded and processed like real ones."""

import json

import numpy as np
import pytest

from defsense_fab.capture.files.formats import read_tracks
from defsense_fab.capture.sessions.session import finished_steps, load
from defsense_fab.cli.main import main
from defsense_fab.core.errors import CaptureError
from defsense_fab.twin.devices.twin_traits import FilmTraits
from tests.support.errors import raises

pytestmark = pytest.mark.slow

SECONDS, RATE = 15.0, 12.0


@pytest.fixture(scope="module")
def filmed(small_bar, tmp_path_factory):
    """Return the folder of a session with two industrial cameras."""
    folder = tmp_path_factory.mktemp("film")
    words = ["capture", "markers", str(small_bar), "--side=0,-1,1", "--skin", "--count", "8"]
    assert main([*words, "--size", "10", "--out", str(folder / "markers")]) == 0
    words = ["twin", str(small_bar), "--cameras", "industrial", "--rate", f"{RATE:g}"]
    words += ["--minutes", f"{SECONDS / 60}", "--markers", str(folder / "markers")]
    assert main([*words, "--out", str(folder / "session"), "--json"]) == 0
    return folder / "session"


def test_session_is_processed_like_a_recorded_one(filmed):
    session = load(filmed)
    assert (session.unit, session.channels) == ("twin-1", ("cord_1", "cord_2"))
    assert len(finished_steps(session)) == len(session.steps) == 5
    quality = json.loads((filmed / "quality.json").read_text(encoding="utf-8"))
    assert quality["twin"]["seed"] == 1
    assert quality["runs"][0]["sync"]["method"] in ("led", "motion")
    assert quality["runs"][0]["steps"][0][1] == "rest"
    assert "cameras" in (filmed / "assumptions.md").read_text(encoding="utf-8")
    assert "marker-noise" not in (filmed / "assumptions.md").read_text(encoding="utf-8")


def test_markers_are_measured_at_their_true_positions(filmed):
    tracks = read_tracks(filmed / "aligned.csv")
    with np.load(filmed / "truth.npz") as truth:
        order = [list(truth["ids"]).index(n) for n in tracks.ids]
        time, points = truth["time"], truth["points"][:, order]
    assert time == pytest.approx(tracks.time, abs=1e-6)
    assert len(time) == pytest.approx(RATE * SECONDS, abs=4)
    assert np.ptp(points, axis=0).max() > 5  # the device moves
    error = np.linalg.norm(tracks.points - points, axis=2)
    assert np.isfinite(error).mean() > 0.8
    assert np.nanmedian(error) < 0.15
    assert np.nanpercentile(error, 90) < 0.6


def test_signals_are_synchronous_with_the_truth(filmed):
    rows = np.genfromtxt(filmed / "samples.csv", delimiter=",", skip_header=1)
    with np.load(filmed / "truth.npz") as truth:
        true_time, ohm = truth["sample_time"], truth["ohm"][:, 0]
    time, read_ohm = rows[:, 3], rows[:, -2]
    shifts = np.arange(-0.06, 0.061, 0.002)
    errors = [np.std(read_ohm - np.interp(time - s, true_time, ohm)) for s in shifts]
    assert abs(shifts[int(np.argmin(errors))]) < 0.012


@pytest.mark.parametrize(
    ("words", "value"),
    [
        (["--cameras", "pinhole"], "pinhole"),
        (["--cameras", "webcam,seed=3"], "seed"),
        (["--cameras", "webcam", "--rate", "500"], "500"),
        (["--cameras", "webcam"], "markers"),
    ],
)
def test_invalid_cameras_are_rejected_before_anything_is_written(
    small_bar, words, value, capsys, tmp_path
):
    out = tmp_path / "out"
    assert main(["twin", str(small_bar), *words, "--out", str(out)]) == 2
    assert value in capsys.readouterr().err
    assert not out.exists()


def test_unknown_kind_of_cameras_is_rejected():
    with raises(CaptureError, "unknown-camera-kind", camera_kind="pinhole"):
        FilmTraits("pinhole")
