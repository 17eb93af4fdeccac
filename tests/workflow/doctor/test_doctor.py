"""Broken libraries are told, not suffered; what answers like a board is asked who it is."""

import os
import sys

import numpy as np
import pytest

from defsense_fab.sensing.response import Response
from defsense_fab.twin.electronics.cords import CordTraits, DeviceCords
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.twin.electronics.virtual_port import PseudoTerminal, SocketPort
from defsense_fab.workflow.doctor import (
    boards,
    cameras,
    doctor,
    isolated,
    libraries,
    licences,
    machine,
)
from defsense_fab.workflow.doctor.finding import Finding

BROKEN = {
    "raises": ("raise ImportError('no libfoo.so.1')", "ImportError: no libfoo.so.1"),
    "crashes": ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashes (SIGSEGV)"),
    "hangs": ("import time; time.sleep(1000)", "hangs: no answer within 1 s"),
}


@pytest.mark.parametrize("way", BROKEN)
def test_broken_library_is_told(way, tmp_path, monkeypatch):
    code, trouble = BROKEN[way]
    (tmp_path / "broken_library.py").write_text(code, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, sys.path)]))
    seconds = 1 if way == "hangs" else 30
    answer = isolated.call(libraries.__name__, "load", "broken_library", seconds=seconds)
    assert answer.trouble == trouble


def test_absent_library_is_missing_where_the_core_needs_it():
    from packaging.requirements import Requirement

    asked = Requirement("no-such-library>=1")
    core = libraries._check(libraries._Asked(asked, ""), 5)
    extra = libraries._check(libraries._Asked(asked, "live"), 5)
    assert (core.status, core.core) == ("missing", True)
    assert (extra.status, extra.core) == ("not needed", False)
    assert core.command.endswith('-m pip install "no-such-library>=1"')


def test_old_library_is_told_by_both_versions():
    from packaging.requirements import Requirement

    found = libraries._check(libraries._Asked(Requirement(f"numpy>{np.__version__}"), ""), 5)
    assert found.status == "missing"
    assert found.told == f"{np.__version__} is installed, >{np.__version__} is asked for"


def test_a_library_of_the_system_is_not_mended_by_pip(monkeypatch):
    from packaging.requirements import Requirement

    for name, package in (("libGL.so.1", "libgl1"), ("libasound.so.2", "libasound2")):
        trouble = f"ImportError: {name}: cannot open shared object file"
        answer = isolated.Answer(trouble=trouble)
        monkeypatch.setattr(libraries, "call", lambda *words, seconds, a=answer: a)
        found = libraries._check(libraries._Asked(Requirement("numpy"), ""), 5)
        assert found.status == "missing"
        assert found.command.startswith("sudo apt-get install ")
        assert package in found.command


def test_a_slow_import_is_waited_for_longer(monkeypatch):
    from packaging.requirements import Requirement

    slow = isolated.Answer(trouble="hangs: no answer within 5 s")
    monkeypatch.setattr(libraries, "call", lambda *words, seconds: slow)
    found = libraries._check(libraries._Asked(Requirement("numpy"), ""), 5)
    assert (found.status, found.command) == ("missing", "defsense doctor --timeout 50")


def test_what_doctor_calls_is_told_without_its_class():
    answer = isolated.call(boards.__name__, "ask", "/dev/no-such-port", seconds=60)
    assert answer.trouble.startswith("/dev/no-such-port: there is no such port")
    assert "doctor" not in answer.trouble


def test_cache_that_cannot_be_written_stops_nothing(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "file"))
    found = machine._cache(60)
    assert (found.status, found.core) == ("not needed", False)
    assert found.command.partition("=")[0].endswith(" DEFSENSE_CACHE")


@pytest.mark.parametrize(
    ("kind", "way"),
    [(PseudoTerminal, "a pseudo-terminal"), (SocketPort, "a socket of this machine")],
)
def test_a_twin_answers_as_boards_do_and_is_told_as_a_program(kind, way):
    response = CordTraits(Response.line(1.0))
    cords = DeviceCords(
        ("a", "b"), np.array([100.0, 80.0]), lambda s: np.zeros(2), response,
        np.random.default_rng(0),
    )  # fmt: skip
    line = kind(ReadoutTwin(cords, 1500.0, offset=5.0))
    try:
        found = boards._check(line.port, 30)
    finally:
        line.close()
    assert found.status == "not needed"
    assert found.told.startswith("firmware ")
    assert f"2 channels by the microcontroller's converter, 50 Hz, but from a program ({way})" in (
        found.told
    )


def test_boards_are_on_usb_or_on_other_machines():
    for port in ("/dev/ttyUSB0", "COM3", "socket://192.168.1.7:4000", "socket://[bad"):
        assert not boards.of_program(port)


def test_finding_checks_itself():
    with pytest.raises(ValueError, match="for what"):
        Finding("a", "b", "not needed", "c")


def test_licences_are_those_of_the_metadata():
    found = {one.name.lower(): one.licence for one in licences.installed_licences()}
    assert "MIT" in found["rich"]
    assert "BSD" in found["numpy"]
    assert "pytest" not in found


def test_picture_of_a_camera_is_written(tmp_path):
    """A video stands in for it: the code is the same but for the address."""
    import cv2

    film = cv2.VideoWriter(
        str(tmp_path / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48)
    )
    for _ in range(30):
        film.write(np.full((48, 64, 3), (0, 0, 200), np.uint8))
    film.release()
    told = cameras.look(str(tmp_path / "film.avi"), str(tmp_path))
    image = cv2.imread(str(tmp_path / "camera-film.png"))
    assert told.startswith("64 x 48 pixels")
    assert np.abs(image.mean(axis=(0, 1)) - (0, 0, 200)).max() < 10


def test_a_check_that_the_system_refuses_does_not_end_the_others(monkeypatch):
    def refused(*_):
        raise PermissionError(13, "Permission denied")

    for name in ("check_libraries", "check_cameras", "check_boards"):
        monkeypatch.setattr(doctor, name, lambda *_: [])
    for name in ("check_graphics", "check_cad", "check_solver", "check_gamepad", "check_midi"):
        monkeypatch.setattr(doctor, name, lambda *_, name=name: Finding("a", name, "good", "b"))
    monkeypatch.setattr(doctor, "check_machine", refused)
    monkeypatch.setattr(doctor, "check_cameras", refused)
    found = {one.about: one for one in doctor.examine(5)}
    assert "Permission denied" in found["machine"].told
    # Without cameras devices can be built; what the core needs must have been looked at.
    assert [found[about].status for about in ("machine", "cameras")] == ["missing", "not needed"]
    assert found["check_midi"].status == "good"
