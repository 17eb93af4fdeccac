"""Test calibration sessions: simulated, damaged and edited ones, and their fits."""

import json
import os
import shutil

import numpy as np
import pytest

from defsense_fab.calibration import session as sessions
from defsense_fab.calibration.calibrate import calibrate
from defsense_fab.calibration.options import BoardOptions, MeasureOptions
from defsense_fab.calibration.protocol import check_settling, fit_creep
from defsense_fab.calibration.readings import BendingSpecimen, join_readings
from defsense_fab.calibration.session_readings import read_session
from defsense_fab.core.errors import CalibrationError, CaptureError
from defsense_fab.core.response import ResponseSpec
from defsense_fab.core.storage.session_manifest import Criterion
from defsense_fab.sensing.response import Response, build_response
from defsense_fab.twin.calibration_session import record_twin
from defsense_fab.twin.electronics.cords import CordTraits, CordTwins
from defsense_fab.workflow.calibrate.fit_response import fit_response
from tests.calibration.new_session import create_session
from tests.support.errors import raises

#: Sessions of the coverage test.
SESSIONS = int(os.environ.get("DEFSENSE_SESSIONS", "2"))


def test_settling_follows_the_criterion():
    time = np.arange(0.05, 30, 0.05)
    ohm = 2000 * (1 + 0.02 * np.exp(-time / 3))[:, None]
    c = Criterion(window=6, tolerance=0.0005, least=8, most=90)
    assert check_settling(time[:50], ohm[:50], c) is None
    is_settled = [check_settling(time[:n], ohm[:n], c).is_settled for n in range(130, len(time))]
    first = time[130 + is_settled.index(True)]
    # The halves' means differ by 0.02 exp(-t/3) (e - 1)^2: less than 0.0005 from 14.3 s on.
    assert first == pytest.approx(3 * np.log(40 * (np.e - 1) ** 2), abs=0.2)
    assert all(is_settled[is_settled.index(True) :])
    at = check_settling(time, ohm, c)
    assert at.ohm == pytest.approx([2000], rel=2e-5)
    assert not at.is_timed_out
    open_cord = np.full((600, 1), np.inf)
    assert not check_settling(time, open_cord[: len(time)], c).is_settled


def test_creep_is_recovered():
    time = np.arange(0.1, 40, 0.1)
    rng = np.random.default_rng(0)
    result = fit_creep(time, 2000 + 30 * np.exp(-time / 7) + rng.normal(0, 1, len(time)))
    assert (result.end, result.start) == pytest.approx((2000, 30), rel=0.05)
    assert result.time == pytest.approx(7, rel=0.15)
    assert np.isnan(fit_creep(time, 2000 + rng.normal(0, 1, len(time))).time)


def test_simulated_cord_lags_and_heals():
    """Its resistance overshoots after a change, either way, and lags behind by its play."""
    traits = CordTraits(Response.line(2.0), noise=0, play=0.003, healing=0.1, time=8.0, spread=0)
    cords = CordTwins(traits, np.array([100.0]), np.random.default_rng(0))
    rest = cords.rest[0]
    cords.stretch(np.array([0.05]))
    _, ohm = cords.measure(600, 1)
    change = ohm[:, 0] / rest - 1
    assert change[0] > 0.1
    assert change[-1] == pytest.approx(0.1 - 0.003, abs=2e-4)
    cords.stretch(np.array([0.0]))
    _, ohm = cords.measure(600, 1)
    assert ohm[0, 0] / rest - 1 > 0.008
    assert ohm[-1, 0] / rest - 1 == pytest.approx(0.003, abs=2e-4)


def calibrate_twins(tmp_path, seed, k=2.0, q=0.0, spec=None, **traits):
    """Calibrate on simulated specimens of two lengths."""
    spec = spec or ResponseSpec("quadratic", {"k": k, "q": q}, (-0.1, 0.1))
    parts = []
    for n, length in enumerate((150.0, 200.0)):
        folder = tmp_path / f"{seed}-{length:g}"
        options, specimen = MeasureOptions(seed=10 * seed + n), BendingSpecimen(length)
        record_twin(folder, CordTraits(build_response(spec), **traits), options, specimen)
        parts.append(read_session(folder).readings)
    return calibrate(join_readings(parts), draws=60)


@pytest.mark.parametrize(
    ("name", "coefficients", "codes"),
    [
        ("line", {"k": -1.5}, {"resistance-falls"}),
        ("quadratic", {"k": 0.0, "q": 25.0}, {"response-not-monotone"}),
        ("quadratic", {"k": 0.4, "q": -25.0}, {"response-not-monotone"}),
        ("cubic", {"k": 1.0, "q": 10.0, "c": 150.0}, set()),
        ("cubic", {"k": -1.0, "q": -10.0, "c": -150.0}, {"resistance-falls"}),
    ],
)
def test_responses_of_filaments_are_found_despite_their_memory(tmp_path, name, coefficients, codes):
    """Resistances that fall, turn or bend, with loops of 10 % of the range, and relaxation."""
    true = ResponseSpec(name, coefficients, (-0.1, 0.1))
    strain = np.linspace(-0.066, 0.066, 41)
    expected = build_response(true)(strain)
    play = 0.05 * np.ptp(expected)
    result = calibrate_twins(
        tmp_path, 1, spec=true, play=play, healing=0.3, noise=0.003, spread=0.03
    )
    assert result.response.model == name
    error = build_response(result.response)(strain) - expected
    assert np.sqrt(np.mean(error**2)) < 0.08 * np.ptp(expected)
    assert {w.code for w in result.warnings} == codes


@pytest.mark.slow
def test_simulated_sessions_reproduce_the_response(tmp_path):
    """Both lengths, nine radii and both faces, as in Fig. 3, with noise, hysteresis, relaxation and
    different pieces."""
    result = [calibrate_twins(tmp_path, s, spread=0.03) for s in range(SESSIONS)]
    covered = sum(f.uncertainty.interval[0] <= 2 <= f.uncertainty.interval[1] for f in result)
    assert covered >= 0.93 * SESSIONS - 1
    assert np.median([abs(f.k_res / 2 - 1) for f in result]) < 0.02
    assert [f.response.model for f in result].count("line") >= 0.9 * SESSIONS
    low, high = result[0].response.strain_range
    assert (low, high) == pytest.approx((-5.5 / 82.5, 5.5 / 82.5))


@pytest.mark.slow
def test_curved_response_is_recognized(tmp_path):
    result = calibrate_twins(tmp_path, 1, q=6.0)
    assert result.response.model == "quadratic"
    assert result.response.coefficients["q"] == pytest.approx(6, abs=1)


def test_session_in_two_runs_fits_like_one(tmp_path):
    """The clock restarts in the second run, which must not affect the memory terms."""
    folder = tmp_path / "whole"
    record_twin(folder, CordTraits(Response.line(2.0)), MeasureOptions(rounds=2))
    shutil.copytree(folder, tmp_path / "split")
    lines = (folder / "frames.csv").read_text("utf-8").splitlines()
    points = [n for n, line in enumerate(lines) if '"point"' in line]
    cut = points[len(points) // 2] + 1
    start = next(line for line in lines if '"start"' in line)
    first = int(lines[cut + 1].split(",")[1])

    def restart_clock(line):
        cells = line.split(",")
        return (
            line if line[0] == "#" else ",".join([cells[0], str(int(cells[1]) - first), *cells[2:]])
        )

    both = [*lines[:cut], start, *map(restart_clock, lines[cut:])]
    (tmp_path / "split" / "frames.csv").write_text("\n".join(both) + "\n")
    whole, split = (read_session(tmp_path / name).readings for name in ("whole", "split"))
    assert split.memory == pytest.approx(whole.memory, abs=2e-3)
    one, two = (calibrate(r, draws=5).k_res for r in (whole, split))
    assert two == pytest.approx(one, rel=1e-3)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("reference", [2200]), ("reference", ["a", 1, 1]), ("reference", [0, 1, 1]),
        ("criterion", "6"), ("steps", [[0, 75, "z"]]), ("steps", [[0, 0, "a"]]), ("steps", 3),
        ("specimen", None), ("rate", "x"), ("schema", 2), ("channels", ["a"]),
    ],
)  # fmt: skip
def test_invalid_session_file_is_refused(tmp_path, key, value):
    session = create_session(tmp_path / "s")
    path = session.folder / "session.json"
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | {key: value}))
    with pytest.raises(CalibrationError, match=r"session.json"):
        sessions.load_session(session.folder)


@pytest.mark.parametrize(
    "event",
    [
        '{"event": "hold", "step": 99}',
        '{"event": "hold", "step": "x"}',
    ],
)
def test_event_of_another_session_is_refused(tmp_path, event):
    session = create_session(tmp_path / "s")
    head = "# defsense recording 1\nhost_ns,device_us,counter,led,late,averages,s1,s2,s3\n"
    session.frames.write_text(f"{head}# {event}\n")
    with raises(CalibrationError, "event-mismatch"):
        read_session(session.folder)


def test_session_without_start_event_is_refused(tmp_path):
    """Its readings are not silently skipped."""
    options = MeasureOptions(radii=(75.0, 112.0, 200.0), rounds=1)
    session = record_twin(tmp_path / "s", CordTraits(Response.line(2.0)), options)
    lines = session.frames.read_text("utf-8").splitlines()
    start = next(n for n, line in enumerate(lines) if '"start"' in line)
    session.frames.write_text("\n".join(lines[:start] + lines[start + 1 :]) + "\n")
    with raises(CaptureError, "full-scale-unknown") as caught:
        read_session(session.folder)
    assert caught.value.where == str(session.frames)
    with raises(CaptureError, "full-scale-unknown"):
        sessions.unfinished_steps(session)
    lines[start] = '# {"event": "start", "full_scale": "a"}'
    session.frames.write_text("\n".join(lines) + "\n")
    with raises(CaptureError, "full-scale-invalid"):
        read_session(session.folder)


@pytest.mark.parametrize(
    ("name", "text", "code"),
    [
        ("session.json", "{", "not-json"),
        ("session.json", "{}", "wrong-schema"),
        ("session.json", None, "file-not-found"),
        ("frames.csv", None, "nothing-recorded"),
        (
            "frames.csv",
            "# defsense recording 1\nhost_ns,device_us,counter,led,late,averages,s1\n",
            "no-step-finished",
        ),
    ],
)
def test_damaged_session_is_refused(tmp_path, name, text, code):
    create_session(tmp_path / "s")
    path = tmp_path / "s" / name
    path.unlink(missing_ok=True)
    if text is not None:
        path.write_text(text)
    with raises(CalibrationError, code):
        read_session(tmp_path / "s")


def test_resumed_session_has_the_requested_options(tmp_path):
    """Options with their default are not compared: they continue whatever was started."""
    session = create_session(tmp_path / "s", rounds=1)
    requested = MeasureOptions(name="s", radii=(200.0, 75.0, 112.0))
    sessions.require_same_options(session, requested, BoardOptions(reference=(2200.0,) * 3))
    with raises(CalibrationError, "session-differs", setting="rounds", value=1):
        sessions.require_same_options(session, MeasureOptions(rounds=2), BoardOptions())
    with raises(CalibrationError, "session-differs", setting="reference"):
        sessions.require_same_options(session, MeasureOptions(), BoardOptions(reference=(1500.0,)))
    fine = MeasureOptions(tolerance=0.07, longest=60)
    other = sessions.create_session(tmp_path / "fine", BendingSpecimen(), fine)
    sessions.require_same_options(other, fine, BoardOptions())


@pytest.mark.parametrize(
    ("radii", "code"), [((75.0, 112.0), "too-few-radii"), ((80.0,), "unknown-radius")]
)
def test_session_with_impossible_radii_is_refused(tmp_path, radii, code):
    with raises(CalibrationError, code):
        sessions.create_session(tmp_path / "s", BendingSpecimen(), MeasureOptions(radii=radii))
    assert not (tmp_path / "s").exists()


def test_source_that_is_given_twice_is_refused(tmp_path):
    """Its readings would count twice, by whatever path, and the interval would be too narrow."""
    folder = tmp_path / "s"
    options = MeasureOptions(radii=(75.0, 100.0, 250.0), rounds=1)
    record_twin(folder, CordTraits(Response.line(2.0)), options)
    (tmp_path / "link").symlink_to(folder)
    out = tmp_path / "r.json"
    with raises(CalibrationError, "source-repeated"):
        fit_response([folder, tmp_path / "link"], out)
    assert not out.exists()
