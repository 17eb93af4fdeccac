"""Progress without a terminal."""

import io
import sys
import time

from defsense_fab.cli.output import ProgressLines


def test_current_step_is_repeated(monkeypatch):
    out = io.StringIO()
    monkeypatch.setattr(sys, "stderr", out)
    with ProgressLines(everything=False, interval=0.5) as report:
        report("tracks", 0.1, "comparing clocks")
        report("tracks", 0.2, "triangulating")  # same stage: not printed immediately
        assert out.getvalue().splitlines() == ["tracks      10 %  comparing clocks"]
        deadline = time.monotonic() + 120
        while len(out.getvalue().splitlines()) < 3 and time.monotonic() < deadline:
            time.sleep(0.01)
        report("tracks", 1.0, "done")
        lines = out.getvalue().splitlines()
        time.sleep(0.8)
    assert all(line.startswith("tracks      20 %  triangulating") for line in lines[1:-1])
    assert "s)" in lines[2]  # elapsed time
    assert out.getvalue().splitlines() == lines  # a completed stage is not repeated
    assert lines[-1].endswith("done")
