"""The response of a cord is measured, fitted and used, on the page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from defsense_fab.calibration.options import MeasureOptions
from defsense_fab.calibration.readings import BendingSpecimen
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.guided_parts import Plot
from defsense_fab.core.response import ResponseSpec
from defsense_fab.sensing.response import build_response
from defsense_fab.studio.measure import calibration_part
from defsense_fab.studio.measure.calibration_part import specimen_sessions
from defsense_fab.twin.calibration_session import record_twin
from defsense_fab.twin.electronics.cords import CordTraits
from defsense_fab.workflow.calibrate.fit_response import fit_response
from tests.runtime.live_frames import wait_for
from tests.studio.devices import InlineProcess

TIMEOUT_S = 600.0
SPECIMEN = {
    "length": 150.0,
    "thickness": 8.0,
    "channels": {"inner": 2.0},
    "jigs": [{"radius": r} for r in (None, 75.0, 100.0, 150.0)],
}


@pytest.fixture
def calibration(studio_page):
    studio_page.enter("Measure")
    part = studio_page.modes["Measure"].calibration
    part.job.process = InlineProcess(part.job.end)
    return part


def write_specimen(folder):
    (folder / "specimen").mkdir()
    (folder / "specimen" / "specimen.json").write_text(json.dumps(SPECIMEN), encoding="utf-8")


@pytest.mark.slow
def test_the_response_is_fitted_and_used_until_it_is_undone(calibration, studio_page):
    bench = studio_page.bench
    folder = bench.project.folder
    calibration.fit()
    assert calibration.status.code == "no-specimen"
    response = ResponseSpec("quadratic", {"k": 2.0, "q": 0.0}, (-0.1, 0.1))
    traits = CordTraits(build_response(response))
    for length in (150.0, 200.0):
        session = folder / f"specimen-twin-{length:g}"
        options = MeasureOptions(seed=int(length), rounds=1)
        record_twin(session, traits, options, BendingSpecimen(length))
    names = [p.name for p in specimen_sessions(folder)]
    assert names == ["specimen-twin-150", "specimen-twin-200"]
    calibration.simulate()
    assert calibration.status.code == "session-exists"
    calibration.fit()
    data = json.loads((folder / "response.json").read_text("utf-8"))
    assert calibration.is_fit_simulated
    assert f"{data['k_res']:.2f}" in calibration.status.text
    assert abs(data["k_res"] - 2.0) < 0.2
    assert calibration.can_use_response
    (folder / "specimen-twin-150").rename(folder / "mine")
    calibration.fit()
    assert not calibration.is_fit_simulated
    measured = json.loads((folder / "response.json").read_text("utf-8"))
    assert [Path(p).name for p in measured["sources"]] == ["mine"]
    before = bench.project.text
    calibration.use()
    assert load_device(folder).cord.compression == "measured"
    assert not calibration.can_use_response
    bench.project.undo()
    assert bench.project.text == before
    assert fit_response([folder / "mine"]).data["k_res"] == measured["k_res"]


def test_a_specimen_is_measured_jig_by_jig_and_continued(calibration, studio_page):
    write_specimen(studio_page.bench.project.folder)
    calibration.set_options(port="twin:speed=50")
    measurement = calibration.measurement
    calibration.start()
    assert wait_for(lambda: measurement.screen is not None or not measurement.is_busy)
    assert measurement.screen is not None, calibration.status.text
    screen = measurement.screen
    assert wait_for(lambda: screen.view is not None)
    assert (screen.view.state.phase, screen.view.state.step) == ("ready", 0)
    screen.press("enter")
    assert wait_for(lambda: len(screen.view.state.done) == 1)
    assert wait_for(lambda: sum(isinstance(p, Plot) for p in screen.view.parts) == 2)
    screen.press("q")
    assert measurement.wait(TIMEOUT_S)
    assert calibration.status.code == "measurement-incomplete"
    assert (measurement.finished_steps, measurement.step_count) == (1, 24)
    assert measurement.screen is None
    calibration.start()
    assert wait_for(lambda: measurement.screen is not None)
    screen = measurement.screen
    assert wait_for(lambda: screen.view is not None and screen.view.state.done == {0})
    calibration.close()
    assert not measurement.is_busy


def test_a_missing_specimen_or_board_is_reported(calibration, studio_page):
    folder = studio_page.bench.project.folder

    def problem():
        calibration.start()
        assert calibration.measurement.wait(TIMEOUT_S)
        return calibration.status.code

    assert problem() == "file-not-found"
    calibration.set_options(specimen="../other")
    assert problem() == "outside-device-folder"
    calibration.set_options(specimen="specimen", port="/dev/nowhere")
    write_specimen(folder)
    assert problem() == "port-not-found"
    assert not (folder / "specimen/session/session.json").exists()


def test_specimens_are_simulated(calibration, monkeypatch):
    simulated = [Path("specimen-twin-150")]
    monkeypatch.setattr(calibration_part, "simulate_specimens", lambda *_, **__: simulated)
    calibration.simulate()
    assert calibration.status.code == "specimens-simulated"
    assert "`specimen-twin-150`" in calibration.status.text
