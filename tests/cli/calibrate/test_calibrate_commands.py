"""The commands `defsense calibrate ...`: what they print and refuse."""

import json

import pytest

from defsense_fab.cli.exit_codes import DONE
from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import CalibrationError, CaptureError, DefsenseError, DeviceError
from tests.calibration.new_session import SPECIMEN, create_session
from tests.support.errors import raises


@pytest.fixture
def run(capsys):
    """Run a command and return what it prints, which is parsed if it is JSON."""

    def run(*words, code=DONE):
        assert run_command(["calibrate", *map(str, words)]) == code
        text = capsys.readouterr().out
        return json.loads(text) if "--json" in words else text

    return run


@pytest.fixture
def specimen(tmp_path):
    (tmp_path / "specimen.json").write_text(json.dumps(SPECIMEN))
    return tmp_path


def record(folder, *words, port="twin"):
    return ["calibrate", "record", "--port", port, "--specimen", str(folder), "--auto", *words]


@pytest.mark.slow
def test_simulated_sessions_are_fitted(tmp_path, run):
    words = ["twin", tmp_path, "--rounds", "1", "--seed", "3"]
    sessions = [str(tmp_path / f"session-{n}") for n in (150, 200)]
    assert " ".join(sessions) in run(*words)
    out = tmp_path / "response.json"
    data = run("fit", *sessions, "--out", out, "--json")
    assert data == json.loads(out.read_text("utf-8"))
    assert data["k_res"] == pytest.approx(2, rel=0.06)
    assert data["hysteresis"] == pytest.approx(0.003, abs=0.002)
    assert 4 < data["creep"]["time"] < 16
    assert data["raw_hash"]
    assert f"{data['k_res']:.2f}" in run("fit", *sessions, "--out", out)
    with raises(CalibrationError, "session-exists"):
        run_command(["calibrate", *map(str, words)])
    (tmp_path / "specimen.json").write_text(json.dumps(SPECIMEN))
    with raises(CalibrationError, "session-finished"):
        run_command(record(tmp_path, "--out", sessions[0]))


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--lengths", "150,-20"], "out-of-range"),
        (["--lengths", "150,150"], "length-repeated"),
        (["--noise", "nan"], "out-of-range"),
    ],
)
def test_impossible_specimens_are_not_simulated(tmp_path, words, code):
    with raises(CalibrationError, code):
        run_command(["calibrate", "twin", str(tmp_path / "t"), *words])
    assert not (tmp_path / "t").exists()


def test_session_that_cannot_start_leaves_no_files(specimen):
    with raises(CaptureError, "board-command-refused"):
        run_command(record(specimen, "--average", "1000"))
    assert not (specimen / "session" / "session.json").exists()


def test_session_is_resumed_with_its_options(specimen):
    create_session(specimen / "session", rounds=1)
    with raises(CalibrationError, "session-differs", setting="rounds", value=1):
        run_command(record(specimen, "--rounds", "2"))


@pytest.mark.parametrize(
    ("flag", "value", "code"),
    [
        ("--seed", "-1", "out-of-range"),
        ("--reference", "nan", "out-of-range"),
        ("--reference", "1,2", "resistance-count-differs"),
        ("--longest", "inf", "out-of-range"),
        ("--radii", "75,112", "too-few-radii"),
        ("--radii", "80", "unknown-radius"),
    ],
)
def test_error_names_the_flag(specimen, flag, value, code):
    with raises(DefsenseError, code) as caught:
        run_command(record(specimen, flag, value))
    assert caught.value.where == flag


def test_recording_cannot_be_measured_again(specimen):
    with raises(CaptureError, "port-is-recording") as caught:
        run_command(record(specimen, port="frames.csv"))
    assert caught.value.where == "--port"


def test_keys_need_a_terminal(specimen):
    words = [word for word in record(specimen) if word != "--auto"]
    with raises(DeviceError, "terminal-missing"):
        run_command(words)


def test_specimen_is_measured_without_keys(specimen, run):
    words = ["record", "--port", "twin:speed=100", "--specimen", specimen, "--auto"]
    data = run(*words, "--rounds", "1", "--faces", "a", "--json")
    assert (data["finished"], data["left"], data["steps"]) == (True, 0, 5)
