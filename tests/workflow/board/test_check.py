"""The check of the wiring on the twin of a built device: faults, guided steps and the command."""

from __future__ import annotations

import json
import os
import threading

import pytest

from benchmarks.board_check import Bench, fault_cases, healthy_cases
from defsense_fab.cli.exit_codes import DONE, NO
from defsense_fab.cli.main import run_command
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import CaptureError
from defsense_fab.workflow.board.check import check_board
from defsense_fab.workflow.board.options import CheckOptions
from tests.support.errors import raises

FAST = "twin:speed=5"


class PressedKeys:
    """A screen on which keys are pressed when a step waits for them; keeps the views."""

    def __init__(self, keys=()):
        self.views, self._keys = [], list(keys)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def show(self, view):
        self.views.append(view)

    def key(self, timeout):
        if self.views[-1].state.phase == "ready":
            return self._keys.pop(0) if self._keys else "enter"
        threading.Event().wait(timeout / 10)
        return None


@pytest.fixture(scope="session")
def bench(wired_bar):
    return Bench(load_device(wired_bar))


@pytest.fixture(scope="session")
def short_bench(wired_bar):
    """Steps as long as in the command, without moved wires."""
    return Bench(load_device(wired_bar), has_wiggle=False)


def test_faults_that_show_without_moved_wires_are_named(short_bench):
    cases = [c for c in fault_cases(["top", "bottom"], 16, seed=7) if c.code != "loose"]
    results = [short_bench.run(case) for case in cases[::2]]
    assert {r.case.options.faults for r in results if not r.is_named} == set()
    assert [f for r in results for f in r.false_alarms] == []


@pytest.mark.slow
def test_every_kind_of_fault_is_named(bench):
    results = [bench.run(case) for case in fault_cases(["top", "bottom"], 16, seed=8)]
    assert {r.case.options.faults for r in results if not r.is_named} == set()
    assert [f for r in results for f in r.false_alarms] == []


def test_sound_units_have_no_findings(bench):
    results = [bench.run(case) for case in healthy_cases(5, seed=7)]
    # Resistances of one piece in 200 are outside of the tolerances; nothing else may be reported.
    codes = [f.code for r in results for f in r.false_alarms]
    assert set(codes) <= {"rest-off"}
    assert len(codes) <= 1


def test_check_guides_through_all_steps(wired_bar):
    screen = PressedKeys()
    result = check_board(wired_bar, f"{FAST},swap=top+bottom", screen=screen)
    assert result.is_complete
    assert result.poses == ("bend",)
    assert [f.code for f in result.findings] == ["swapped", "swapped"]
    steps = {v.state.step for v in screen.views if v.state.phase == "active"}
    assert steps == {0, 1, 2, 3}
    end = screen.views[-1]
    assert end.state.phase == "done"
    assert [n.code for n in end.notes] == ["swapped", "swapped"]
    assert end.parts[0].states == ("fault", "fault")


def test_skipped_steps_are_not_checked(wired_bar):
    screen = PressedKeys(["enter", "s", "s", "s"])
    result = check_board(wired_bar, FAST, screen=screen)
    assert not result.is_complete
    assert result.is_sound


def test_check_that_is_stopped_has_no_findings(wired_bar):
    result = check_board(wired_bar, FAST, screen=PressedKeys(["q"]))
    assert result.findings == ()


def test_cords_of_one_resistance_are_not_distinguishable_without_poses(wired_bar):
    options = CheckOptions(poses=False, wiggle=False)
    result = check_board(wired_bar, FAST, options, screen=PressedKeys())
    assert [n.code for n in result.notices] == ["not-distinguishable"]


def test_command_returns_whether_the_wiring_is_sound(wired_bar, capsys):
    words = ["board", "check", str(wired_bar), "--auto", "--no-wiggle", "--no-poses", "--json"]
    assert run_command([*words, "--port", FAST]) == DONE
    assert json.loads(capsys.readouterr().out)["sound"]
    assert run_command([*words, "--port", f"{FAST},cut=top,unread=bottom"]) == NO
    data = json.loads(capsys.readouterr().out)
    assert [c["code"] for c in data["channels"]] == ["open", "not-read"]
    assert data["channels"][1]["data"]["ohm"] is None


@pytest.mark.parametrize(
    ("port", "code"),
    [
        ("twin:melt=top", "source-invalid"),
        ("twin:speed=0", "source-invalid"),
        ("twin:cut=middle", "unknown-channel"),
        ("board.csv", "port-is-recording"),
        (os.devnull, "port-unavailable"),
    ],
)
def test_invalid_ports_are_refused(wired_bar, port, code):
    with raises(CaptureError, code):
        check_board(wired_bar, port, screen=PressedKeys(), auto=True)


def test_number_of_reference_resistors_is_checked(wired_bar):
    with raises(CaptureError, "resistance-count-differs"):
        check_board(wired_bar, FAST, CheckOptions(reference=(1.0, 2.0, 3.0)), screen=PressedKeys())


def test_device_without_a_build_is_refused(wired_bar, tmp_path):
    for file in wired_bar.iterdir():
        if file.is_file():
            (tmp_path / file.name).write_bytes(file.read_bytes())
    with raises(CaptureError, "not-built"):
        check_board(tmp_path, FAST, screen=PressedKeys())
