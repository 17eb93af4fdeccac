"""A cord's response is measured, fitted and used, from the page."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest

from defsense_fab.calibration import session as sessions
from defsense_fab.calibration.readings import Geometry
from defsense_fab.cli.calibrate import calibrate_record
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.response import ResponseSpec
from defsense_fab.sensing.response import build_response
from defsense_fab.studio.measure import jobs
from defsense_fab.studio.measure.calibration_part import specimen_sessions
from defsense_fab.twin.calibration_session import record_twin
from defsense_fab.twin.electronics.cords import CordTraits
from defsense_fab.workflow.calibrate.fit_response import fit_response
from tests.runtime.live_frames import wait_for

LONG = 60.0
SPECIMEN = {
    "length": 150.0, "thickness": 8.0, "channels": {"inner": 2.0},
    "jigs": [{"radius": r} for r in (None, 75.0, 100.0, 150.0)],
}  # fmt: skip


class Inline:
    """In place of a process."""

    running = False

    def __init__(self, part):
        self.part = part

    def start(self, job):
        self.part._ended(None, job(lambda *_: None))
        return True

    def cancel(self):
        pass

    close = cancel


@pytest.fixture
def calibration(studio_page):
    studio_page.enter("Measure")
    part = studio_page.modes["Measure"].calibration
    part.work = Inline(part)
    return part


def specimen(folder):
    (folder / "specimen").mkdir()
    (folder / "specimen" / "specimen.json").write_text(json.dumps(SPECIMEN), encoding="utf-8")


def test_the_response_is_fitted_and_used_until_it_is_undone(calibration, studio_page):
    bench = studio_page.bench
    folder = bench.project.folder
    calibration.fit()
    assert "No specimen was measured yet" in calibration._told.content
    traits = CordTraits(build_response(ResponseSpec("quadratic", {"k": 2.0, "q": 0.0}, (-0.1, 0.1))))
    for length in (150.0, 200.0):
        session = folder / f"specimen-twin-{length:g}"
        record_twin(session, traits, seed=int(length), length=length, rounds=1)
    assert [p.name for p in specimen_sessions(folder)] == [
        "specimen-twin-150", "specimen-twin-200",
    ]  # fmt: skip
    calibration.simulate()
    assert "is there already" in calibration._told.content
    calibration.fit()
    told = json.loads((folder / "response.json").read_text("utf-8"))
    assert "says nothing of a real cord" in calibration._told.content
    assert f"**k_res = {told['k_res']:.2f}** (95 %: " in calibration._told.content
    assert abs(told["k_res"] - 2.0) < 0.2
    assert calibration._use.visible
    (folder / "specimen-twin-150").rename(folder / "mine")
    calibration.fit()
    assert "simulated" not in calibration._told.content
    again = json.loads((folder / "response.json").read_text("utf-8"))
    assert [Path(p).name for p in again["sources"]] == ["mine"]
    before = bench.project.text
    calibration.use()
    device = load_device(folder)
    assert device.cord.compression == "measured"
    assert bench.project.undo_name == "use the measured response response.json"
    bench.project.undo()
    assert bench.project.text == before
    assert fit_response([folder / "mine"]).data["k_res"] == again["k_res"]


def test_a_specimen_is_measured_jig_by_jig_and_gone_on_with(calibration, studio_page):
    specimen(studio_page.bench.project.folder)
    calibration._port.value = "twin:speed=50"
    before = set(calibration._folder._children)
    calibration.start()
    assert wait_for(lambda: calibration.screen is not None or not calibration.busy)
    assert calibration.screen is not None, calibration._told.content
    said = calibration.screen._said
    assert wait_for(lambda: "Lay the specimen on **the flat jig**" in said.content)
    calibration.screen.press("enter")
    assert wait_for(lambda: "1 of 24 readings" in said.content)
    assert wait_for(lambda: "<circle" in calibration.screen._plot.content)
    calibration.screen.press("q")
    assert calibration.wait(LONG)
    assert "1 of 24 readings are done: *Measure a specimen* goes on" in calibration._told.content
    assert set(calibration._folder._children) == before
    calibration.start()
    assert wait_for(lambda: calibration.screen is not None)
    said = calibration.screen._said
    assert wait_for(lambda: "1 of 24 readings" in said.content)
    calibration.close()
    assert not calibration.busy


def test_what_lacks_is_told(calibration, studio_page):
    calibration.start()
    assert calibration.wait(LONG)
    assert "defsense calibrate specimen" in calibration._told.content
    calibration._specimen.value = "../other"
    calibration.start()
    assert calibration.wait(LONG)
    assert "outside of the device's folder" in calibration._told.content
    calibration._specimen.value = "specimen"
    specimen(studio_page.bench.project.folder)
    calibration._port.value = "/dev/nowhere"
    calibration.start()
    assert calibration.wait(LONG)
    assert "/dev/nowhere: there is no such port" in calibration._told.content
    assert not (studio_page.bench.project.folder / "specimen/session/session.json").exists()


def test_simulated_specimens_are_named(calibration, monkeypatch):
    monkeypatch.setattr(jobs, "simulate_specimens", lambda *_: ["specimen-twin-150"])
    calibration.simulate()
    assert calibration._told.content == "Simulated `specimen-twin-150`: *Fit the response*."


def test_the_page_and_the_command_want_the_same():
    about = {"length": 150.0, "geometry": Geometry(8.0, 2.0), "radii": [75.0, 100.0, 150.0]}
    options = argparse.Namespace(**dict.fromkeys(calibrate_record._DEFAULTS))
    assert calibrate_record._session_fields(options, about) == sessions.default_settings(about)
