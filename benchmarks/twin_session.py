"""A session before each kind of the twin's cameras, against the truth.

    python -m benchmarks.twin_session my-device                     # built, with printed tags
    python -m benchmarks.twin_session my-device webcam --seed 3 --cameras 3

Records the twin of a device in real time, as `defsense capture record --cameras twin:KIND --auto`
does, processes the session, and compares the aligned markers with where the twin's tags were, in
the device's frame. `seen` is the part of the tags and frames with a place, of those that face two
cameras; `error` the median and the 95th percentile of the distance from the truth, mm; `inside` the
part of the coordinates within two stated standard deviations; `lag` what the cameras' time is late
by, ms; `signals` how far the read-out board's time is off by, ms, once the lag is known, against
what is `stated`.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from defsense_fab.capture.files.formats import read_tracks
from defsense_fab.capture.sessions.recorded_tags import read_camera_tags
from defsense_fab.capture.sessions.session import load
from defsense_fab.cli.main import main as defsense
from defsense_fab.core.arrays import Float
from defsense_fab.twin.filming.camera_kinds import CAMERA_KINDS
from defsense_fab.twin.live import live_twin

#: mm/s and mm: what tells the cameras' lag.
_FAST, _SURE = 20.0, 0.2


def record(device: Path, out: Path, kind: str, seed: int, cameras: int) -> live_twin.LiveTwin:
    """A session in `out`, and the twin that was recorded."""
    started: list[live_twin.LiveTwin] = []
    start = live_twin.start_live_twin

    def kept(*values: Any, **named: Any) -> live_twin.LiveTwin:
        started.append(start(*values, **named))
        return started[0]

    live_twin.start_live_twin = kept
    try:
        code = defsense(
            [
                "capture",
                "record",
                str(device),
                "--cameras",
                f"twin:{kind},seed={seed},cameras={cameras}",
                "--port",
                "twin",
                "--auto",
                "--out",
                str(out),
                "--rounds",
                "1",
                "--free",
                "8",
                "--rest",
                "3",
            ]
        ) or defsense(["capture", "process", str(out)])
    finally:
        live_twin.start_live_twin = start
    if code:
        raise SystemExit(code)
    return started[0]


def truth(twin: live_twin.LiveTwin, times: Float) -> Float:
    """Return the tags (t, m, 3) mm at times (t,) s, without the sway of the hand."""
    out = []
    for t in times:
        w = twin.player.weights(float(t))
        w = np.pad(w, (0, twin.state_count - len(w)))
        out.append([p.center for p in twin.device.deform(w)[1]])
    return np.array(out)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("device", type=Path)
    parser.add_argument("kind", nargs="*", help=f"of {', '.join(CAMERA_KINDS)}")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cameras", type=int, default=2)
    options = parser.parse_args()
    for kind in options.kind or CAMERA_KINDS:
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "session"
            twin = record(options.device, out, kind, options.seed, options.cameras)
            compare(kind, twin, out)


def compare(kind: str, twin: live_twin.LiveTwin, out: Path) -> None:
    session, tracks = load(out), read_tracks(out / "aligned.csv")
    run = session.runs[0]
    names = [c.name for c in session.rig.cameras]
    starts = [int(read_camera_tags(run, n, len(session.markers.ids)).time[0]) for n in names]
    began = (starts[0] - twin.started_ns) / 1e9  # the first camera's first frame is at 0 s
    order = [list(tracks.ids).index(n) for n in session.markers.ids if n in tracks.ids]
    known = np.isin(session.markers.ids, tracks.ids)
    points, sigma = tracks.points[:, order], tracks.sigma[:, order]
    lags = np.arange(-0.02, 0.081, 0.002)
    grid = np.arange(tracks.time[0] - 0.1, tracks.time[-1] + 0.1, 0.01)
    true = truth(twin, grid + began)[:, known].reshape(len(grid), -1)

    def off(lag: float) -> Float:
        at = np.stack([np.interp(tracks.time - lag, grid, c) for c in true.T], axis=1)
        return points - at.reshape(points.shape)

    speed = np.gradient(true, 0.01, axis=0).reshape(len(grid), -1, 3)
    fast = np.linalg.norm(speed, axis=2)[np.searchsorted(grid, tracks.time)] > _FAST
    sure = fast & (sigma.max(axis=2) < _SURE)
    errors = [np.nanmedian(np.linalg.norm(off(lag), axis=2)[sure]) for lag in lags]
    lag = float(lags[int(np.argmin(errors))])
    wrong = off(lag)
    error = np.linalg.norm(wrong, axis=2)
    told = np.isfinite(error)
    quality = json.loads((out / "quality.json").read_text())
    sync = quality["runs"][0]["sync"]
    # camera = offset + (1 + drift) device, from the first stamp of all on; device = OFFSET +
    # (1 + DRIFT) scene.
    middle = float(grid.mean())
    first = (starts[0] - min(starts)) / 1e9
    at = (middle + first - sync["offset"]) / (1 + sync["drift"])
    scene = (at - live_twin.OFFSET) / (1 + live_twin.DRIFT)
    wait = middle - lag + began - scene
    sys.stdout.write(
        f"{kind:12} {len(tracks.time)} frames, seen {told.mean():.0%}, error median"
        f" {np.median(error[told]):.3f}, p95 {np.percentile(error[told], 95):.3f} mm, inside"
        f" {(np.abs(wrong) <= 2 * sigma)[told].mean():.0%}, lag {1e3 * lag:.0f} ms, signals"
        f" {1e3 * wait:.1f} ms off by {sync['method']}, stated {sync['error_ms']}, notes"
        f" {len(quality.get('warnings', []))}\n"
    )
    sys.stdout.flush()


if __name__ == "__main__":
    main()
