"""Output of commands without a terminal: progress, and a full or closed standard output."""

import io
import subprocess
import sys
import time

from defsense_fab.cli.output import ProgressLines


def test_current_step_is_repeated(monkeypatch):
    out = io.StringIO()
    monkeypatch.setattr(sys, "stderr", out)
    with ProgressLines(everything=False, interval=0.5) as report:
        report("tracks", 0.1, "comparing clocks")
        report("tracks", 0.2, "triangulating")  # same stage: not printed immediately
        assert out.getvalue().split() == ["tracks", "10", "%", "comparing", "clocks"]
        deadline = time.monotonic() + 120
        while len(out.getvalue().splitlines()) < 3 and time.monotonic() < deadline:
            time.sleep(0.01)
        report("tracks", 1.0, "done")
        lines = out.getvalue().splitlines()
        time.sleep(0.8)
    assert all(line.split()[:4] == ["tracks", "20", "%", "triangulating"] for line in lines[1:-1])
    assert "s)" in lines[2]  # elapsed time
    assert out.getvalue().splitlines() == lines  # a completed stage is not repeated
    assert lines[-1].endswith("done")


def test_unreadable_output_gives_no_traceback(tmp_path):
    code = (
        "from defsense_fab.cli import output as cli\nwith cli.standard_output(): print('x' * 99999)"
    )
    with open("/dev/full", "w") as full:
        out = subprocess.run(
            [sys.executable, "-c", code], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert "standard output: No space left on device" in out.stderr
    piped = subprocess.run(
        ["bash", "-c", f'"{sys.executable}" -c "{code}" | true; exit ${{PIPESTATUS[0]}}'],
        capture_output=True,
        text=True,
    )
    assert (piped.returncode, piped.stderr) == (0, "")
