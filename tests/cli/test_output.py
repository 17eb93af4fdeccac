"""Progress where there is no terminal."""

import io
import sys
import time

from defsense_fab.cli.output import ProgressLines


def test_lines_go_on_while_nothing_is_told(monkeypatch):
    out = io.StringIO()
    monkeypatch.setattr(sys, "stderr", out)
    with ProgressLines(everything=False, interval=0.5) as tell:
        tell("tracks", 0.1, "comparing clocks")
        tell("tracks", 0.2, "triangulating")  # another step of the same stage: not at once
        assert out.getvalue().splitlines() == ["tracks      10 %  comparing clocks"]
        until = time.monotonic() + 20
        while len(out.getvalue().splitlines()) < 3 and time.monotonic() < until:
            time.sleep(0.01)
        tell("tracks", 1.0, "done")
        lines = out.getvalue().splitlines()
        time.sleep(0.8)
    assert all(line.startswith("tracks      20 %  triangulating") for line in lines[1:-1])
    assert "s)" in lines[2]  # for how long
    assert out.getvalue().splitlines() == lines  # what is done does not go on
    assert lines[-1].endswith("done")
