"""The commands `defsense board ...`: what they print and refuse."""

import json

import pytest

from defsense_fab.cli.exit_codes import DONE
from defsense_fab.cli.main import run_command
from defsense_fab.core.errors import CaptureError, DefsenseError
from tests.support.errors import raises


@pytest.fixture
def run(capsys):
    """Run a command and return what it prints, which is parsed if it is JSON."""

    def run(*words, code=DONE):
        assert run_command(["board", *map(str, words)]) == code
        text = capsys.readouterr().out
        return json.loads(text) if "--json" in words else text

    return run


def test_board_is_shown(run):
    data = run("ports", "--port", "twin", "--seconds", "0.5", "--json")
    assert len(data["ohm"]) == 3
    assert data["samples"] > 0
    assert "channel 3" in run("ports", "--port", "twin", "--seconds", "0.5")
    assert isinstance(run("ports", "--list", "--json"), list)
    with raises(CaptureError, "source-invalid"):
        run_command(["board", "ports", "--port", "twin:pace=3"])


@pytest.mark.parametrize("seconds", ["0", "-1", "nan"])
def test_invalid_duration_is_refused(seconds):
    with raises(DefsenseError, "out-of-range") as caught:
        run_command(["board", "ports", "--port", "twin", "--seconds", seconds])
    assert caught.value.where == "--seconds"


def test_reference_resistors_are_measured(run):
    data = run("reference", "--port", "twin", "--known", "2500", "--json")
    assert 1500 < min(data["reference"]) < 3500
    assert "--reference" in run("reference", "--port", "twin", "--known", "2500")
