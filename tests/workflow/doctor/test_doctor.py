"""Checks of the machine: broken libraries, boards and programs behind ports, cameras, licences."""

import os
import sys

import numpy as np
import pytest

from defsense_fab.workflow.doctor import checks, doctor, hardware, libraries, machine
from defsense_fab.workflow.doctor.checks import Finding

BROKEN = {
    "raises": ("raise ImportError('no libfoo.so.1')", "ImportError: no libfoo.so.1"),
    "crashes": ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashes (SIGSEGV)"),
    "hangs": ("import time; time.sleep(1000)", "hangs: no answer within 1 s"),
}


@pytest.mark.parametrize("way", BROKEN)
def test_broken_library_is_reported(way, tmp_path, monkeypatch):
    code, failure = BROKEN[way]
    (tmp_path / "broken_library.py").write_text(code, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, sys.path)]))
    seconds = 1 if way == "hangs" else 30
    answer = checks.call(libraries.__name__, "import_module", "broken_library", seconds=seconds)
    assert answer.failure == failure


def test_absent_library_is_missing_if_the_core_needs_it():
    from packaging.requirements import Requirement

    requirement = Requirement("no-such-library>=1")
    core = libraries.check_library(libraries.RequiredLibrary(requirement, ""), 5)
    extra = libraries.check_library(libraries.RequiredLibrary(requirement, "live"), 5)
    assert (core.status, core.needed_for) == ("missing", "")
    assert extra.status == "not needed"
    assert extra.needed_for
    assert core.command.endswith('-m pip install "no-such-library>=1"')


def test_outdated_library_is_reported_with_both_versions():
    from packaging.requirements import Requirement

    finding = libraries.check_library(
        libraries.RequiredLibrary(Requirement(f"numpy>{np.__version__}"), ""), 5
    )
    assert finding.status == "missing"
    assert finding.message.count(np.__version__) == 2


def test_missing_system_library_is_not_installed_by_pip(monkeypatch):
    from packaging.requirements import Requirement

    for name, package in (("libGL.so.1", "libgl1"), ("libasound.so.2", "libasound2")):
        failure = f"ImportError: {name}: cannot open shared object file"
        answer = checks.Answer(failure=failure)
        monkeypatch.setattr(libraries, "call", lambda *words, seconds, a=answer: a)
        finding = libraries.check_library(libraries.RequiredLibrary(Requirement("numpy"), ""), 5)
        assert finding.status == "missing"
        assert finding.command.startswith("sudo apt-get install ")
        assert package in finding.command


def test_slow_import_suggests_a_longer_time_limit(monkeypatch):
    from packaging.requirements import Requirement

    slow = checks.Answer(failure="hangs: no answer within 5 s")
    monkeypatch.setattr(libraries, "call", lambda *words, seconds: slow)
    finding = libraries.check_library(libraries.RequiredLibrary(Requirement("numpy"), ""), 5)
    assert (finding.status, finding.command) == ("missing", "defsense doctor --timeout 50")


def test_errors_are_reported_without_their_class():
    answer = checks.call(hardware.__name__, "describe_board", "/dev/no-such-port", seconds=60)
    assert answer.failure.startswith("/dev/no-such-port: ")
    assert "doctor" not in answer.failure


def test_cache_that_cannot_be_written_is_not_fatal(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "file"))
    finding = machine.check_cache(60)
    assert finding.status == "not needed"
    assert finding.command.partition("=")[0].endswith(" DEFSENSE_CACHE")


def test_licences_come_from_the_metadata():
    licences = {row.name.lower(): row.licence for row in libraries.installed_licences()}
    assert "MIT" in licences["rich"]
    assert "BSD" in licences["numpy"]
    assert "pytest" not in licences
    assert "LGPL" in licences["firmware: arduinocore-avr"]


def test_picture_of_a_camera_is_written(tmp_path):
    """A video replaces the camera: only the address differs."""
    import cv2

    film = cv2.VideoWriter(
        str(tmp_path / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48)
    )
    for _ in range(30):
        film.write(np.full((48, 64, 3), (0, 0, 200), np.uint8))
    film.release()
    text = hardware.take_picture(str(tmp_path / "film.avi"), str(tmp_path))
    image = cv2.imread(str(tmp_path / "camera-film.png"))
    assert text.startswith("64 x 48 pixels")
    assert np.abs(image.mean(axis=(0, 1)) - (0, 0, 200)).max() < 10


def test_check_without_permission_does_not_end_the_others(monkeypatch):
    def deny(*_):
        raise PermissionError(13, "Permission denied")

    for name in ("check_libraries", "check_cameras", "check_boards"):
        monkeypatch.setattr(doctor, name, lambda *_: [])
    for name in ("check_graphics", "check_cad", "check_solver", "check_gamepad", "check_midi"):
        monkeypatch.setattr(doctor, name, lambda *_, name=name: Finding("a", name, True, "b"))
    monkeypatch.setattr(doctor, "check_machine", deny)
    monkeypatch.setattr(doctor, "check_cameras", deny)
    findings = {finding.about: finding for finding in doctor.examine()}
    assert "Permission denied" in findings["machine"].message
    # Devices can be built without cameras, but the core must be checked.
    assert [findings[about].status for about in ("machine", "cameras")] == ["missing", "not needed"]
    assert findings["check_midi"].status == "good"
