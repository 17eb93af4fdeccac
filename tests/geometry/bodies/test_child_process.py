"""Scripts and the mesher in child processes: modules, limits, Ctrl-C, crashes."""

import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from defsense_fab.core.device.device import BodySpec
from defsense_fab.core.errors import BodyError, MeshingError
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from tests.support.body_scripts import HEAD
from tests.support.errors import raises

BOX = HEAD + "import helper\ndef body(): return box(helper.SIZE, 10, 10)\n"
#: Writes its process's number, starts another process, and sleeps.
SLEEPER = (
    "import os, pathlib, subprocess, time\n"
    "def body(file):\n"
    "    other = subprocess.Popen(['sleep', '300'])\n"
    "    pathlib.Path(file + '.part').write_text(f'{os.getpid()} {other.pid}')\n"
    "    os.replace(file + '.part', file)\n"
    "    time.sleep(300)\n"
)


def gone(pids, seconds=120):
    """Whether all processes have ended, or are at least only waited for."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if not any(running(pid) for pid in pids):
            return True
        time.sleep(0.05)
    return False


def running(pid):
    listing = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True)
    return bool(listing.stdout.strip()) and not listing.stdout.startswith("Z")


def appears(file, seconds=60):
    end = time.monotonic() + seconds
    while not file.exists():
        assert time.monotonic() < end, f"{file} did not appear"
        time.sleep(0.05)
    return [int(word) for word in file.read_text("utf-8").split()]


@pytest.fixture
def interrupts():
    """Ctrl-C is a KeyboardInterrupt: background jobs of a shell begin with the signal ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.slow
def test_two_devices_may_have_helpers_of_one_name(tmp_path):
    for name, size in (("a", 20), ("b", 40)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "body.py").write_text(BOX)
        (tmp_path / name / "helper.py").write_text(f"SIZE = {size}\n")
    bodies = [load_body(BodySpec("script", tmp_path / n / "body.py")) for n in ("a", "b")]
    assert [b.volume for b in bodies] == pytest.approx([2000, 4000])
    assert "helper" not in sys.modules


@pytest.mark.slow
def test_effects_of_a_script_stay_in_its_process(tmp_path, capsys):
    (tmp_path / "body.py").write_text(
        f"import os, sys\n{HEAD}"
        "os.environ['MARK'] = '1'; os.chdir('/'); sys.path.clear(); print('said')\n"
        "def body(): return box(10, 10, 10)\n"
    )
    importlib.import_module("defsense_fab.geometry.kernels.occ")  # which adds to sys.path itself
    before = (os.getcwd(), list(sys.path))
    assert load_body(BodySpec("script", tmp_path / "body.py")).volume == pytest.approx(1000)
    assert (os.getcwd(), list(sys.path)) == before
    assert "MARK" not in os.environ
    assert capsys.readouterr() == ("", "said\n")


def test_endless_script_is_stopped_with_its_processes(tmp_path):
    (tmp_path / "body.py").write_text(SLEEPER)
    file = tmp_path / "pids"
    spec = BodySpec("script", tmp_path / "body.py", {"file": str(file)}, time_limit=2)
    with raises(BodyError, "time-limit-exceeded", limit=2):
        load_body(spec)
    assert gone(appears(file, 1))


def test_ctrl_c_stops_a_script_with_its_processes(tmp_path, interrupts):
    (tmp_path / "body.py").write_text(SLEEPER)
    file = tmp_path / "pids"

    def interrupt():
        appears(file)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        load_body(BodySpec("script", tmp_path / "body.py", {"file": str(file)}))
    assert gone(appears(file))


def test_script_ends_with_its_killed_caller(tmp_path):
    (tmp_path / "body.py").write_text(SLEEPER)
    file = tmp_path / "pids"
    code = (
        "from pathlib import Path\nfrom defsense_fab.core.device.device import BodySpec\n"
        "from defsense_fab.geometry.bodies.body import load_body\n"
        f"load_body(BodySpec('script', Path({str(tmp_path / 'body.py')!r}),"
        f" {{'file': {str(file)!r}}}))"
    )
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL) as caller:
        pids = appears(file)
        caller.kill()
    assert gone(pids)


@pytest.mark.parametrize(
    ("end", "returncode"),
    [("os.kill(os.getpid(), 11)", -11), ("os._exit(3)", 3), ("os.kill(os.getpid(), 9)", -9)],
)
def test_crash_of_a_script_is_reported_in_one_line(tmp_path, end, returncode):
    (tmp_path / "body.py").write_text(f"import os\ndef body():\n    print('before')\n    {end}\n")
    with raises(BodyError, "process-ended-early", returncode=returncode) as caught:
        load_body(BodySpec("script", tmp_path / "body.py"))
    assert caught.value.data["last_line"] == "before"
    assert caught.value.is_machine_limit == (returncode == -9)
    assert "\n" not in str(caught.value)


def test_a_script_finds_nothing_on_standard_input(tmp_path):
    (tmp_path / "body.py").write_text("def body(): return input()\n")
    with raises(BodyError, "script-raises", line=1, exception="EOFError"):
        load_body(BodySpec("script", tmp_path / "body.py"))


@pytest.mark.slow
def test_parameters_are_converted_to_json(tmp_path):
    import datetime

    import numpy as np

    (tmp_path / "body.py").write_text(HEAD + "def body(a, b): return box(a, b['c'][0], 10)\n")
    spec = BodySpec("script", tmp_path / "body.py", {"a": np.int64(20), "b": {"c": [5.0]}})
    assert load_body(spec).volume == pytest.approx(1000)
    spec = BodySpec("script", tmp_path / "body.py", {"a": datetime.date(2020, 1, 1), "b": 1})
    with raises(BodyError, "unsupported-parameter"):
        load_body(spec)


@pytest.mark.slow
@pytest.mark.parametrize("limit", [0.5, 1e-3], ids=["while it runs", "before it starts"])
def test_the_mesher_is_stopped_at_its_limit(bar, limit):
    with raises(MeshingError, "no-mesh", limit=limit, out_of_time=True):
        tetrahedralize(bar, 1.5, time_limit=limit)


@pytest.mark.slow
def test_ctrl_c_stops_the_mesher(bar, interrupts, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    pids_found = []

    def interrupt():
        deadline = time.monotonic() + 120
        while not pids_found and time.monotonic() < deadline:
            listing = subprocess.run(
                ["ps", "-ww", "-eo", "pid=,args="], capture_output=True, text=True
            )
            pids_found.extend(
                int(line.split()[0])
                for line in listing.stdout.splitlines()
                if str(tmp_path) in line and "meshers" in line
            )
        time.sleep(1)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        tetrahedralize(bar, 1.5)
    assert pids_found
    assert gone(pids_found)
    assert list(Path(tmp_path).iterdir()) == []
