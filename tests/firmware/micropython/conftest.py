"""Run the program's scenarios in MicroPython's WebAssembly build and in CPython."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
PROGRAM = ROOT / "defsense_fab/data/firmware/micropython"
SCENARIOS = HERE / "on_board"
PACKAGE = "@micropython/micropython-webassembly-pyscript"
#: Where `make test` installs the package.
TIMEOUT_S = 300  # of a scenario, on a busy machine
INTERPRETER = ROOT / ".venv/node/node_modules" / PACKAGE / "micropython.mjs"


def run_in_micropython(folder):
    if shutil.which("node") is None or not INTERPRETER.exists():
        pytest.skip(f"node or {PACKAGE} is missing: make test installs them")
    script = folder / "script.py"
    script.write_text("import scenarios\nscenarios.main('')\n")
    folders = f"{PROGRAM},{SCENARIOS}"
    command = [
        "node",
        HERE / "run_program.mjs",
        INTERPRETER,
        folders,
        script,
        folder / "input.json",
    ]
    return subprocess.run(command, capture_output=True, encoding="utf-8", timeout=TIMEOUT_S)


def run_in_cpython(folder):
    code = (
        f"import sys; sys.path[:0] = [{str(PROGRAM)!r}, {str(SCENARIOS)!r}]\n"
        f"import scenarios; scenarios.main({str(folder)!r})\n"
        f"print(open({str(folder / 'output.json')!r}).read())"
    )
    command = [sys.executable, "-c", code]
    return subprocess.run(command, capture_output=True, encoding="utf-8", timeout=TIMEOUT_S)


@pytest.fixture(params=["micropython", "cpython"])
def run_scenario(request, tmp_path):
    """Function that runs a function of `on_board/scenarios.py` and returns its result."""

    def run(name, argument):
        (tmp_path / "input.json").write_text(json.dumps([name, argument]))
        run_in = run_in_micropython if request.param == "micropython" else run_in_cpython
        done = run_in(tmp_path)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


class LoopbackBoard:
    """The program in a process of CPython, on sockets of this machine and a pseudo-terminal.

    Args:
        settings: File with the board's stored settings.
        port: Number of the UDP and TCP ports; 0 for any free ones.
    """

    def __init__(self, settings, port=0):
        command = [sys.executable, HERE / "loopback_board.py", PROGRAM, settings, str(port)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, encoding="utf-8")
        ports = json.loads(self._process.stdout.readline())
        self.serial, self.udp, self.tcp = ports["serial"], ports["udp"], ports["tcp"]

    def stop(self):
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()


@pytest.fixture
def settings(tmp_path):
    """File with the board's stored settings."""
    return tmp_path / "defsense.json"


@pytest.fixture
def start_board(settings, tmp_path, monkeypatch):
    """Function that starts a board; paired boards are those of this test."""
    if os.name == "nt":
        pytest.skip("pseudo-terminals are missing")
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "config"))
    boards = []

    def start(stored=None, port=0):
        if stored is not None:
            settings.write_text(json.dumps(stored))
        boards.append(LoopbackBoard(settings, port))
        return boards[-1]

    yield start
    for board in boards:
        board.stop()
