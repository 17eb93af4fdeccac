"""Run the program's scenarios in MicroPython's WebAssembly build and in CPython."""

import json
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
    return subprocess.run(command, capture_output=True, text=True)


def run_in_cpython(folder):
    code = (
        f"import sys; sys.path[:0] = [{str(PROGRAM)!r}, {str(SCENARIOS)!r}]\n"
        f"import scenarios; scenarios.main({str(folder)!r})\n"
        f"print(open({str(folder / 'output.json')!r}).read())"
    )
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)


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
