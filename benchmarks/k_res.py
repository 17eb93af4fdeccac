"""Whether the interval of k_res holds the truth, for responses and hysteresis that no model has.

    python -m benchmarks.k_res                     # 30 seeds of each condition
    python -m benchmarks.k_res --seeds 100 --rounds 2

Two specimens with a cord on either face are laid on the radius jigs in random order, `--rounds`
times over and turned over half of the time, and read after 20 s of 30 s. Pieces have gains that
differ by 3 or 6 %. Cords follow a line, a kink, a cubic or an exponential of strain, whose slope at
rest is 2 (of the kink, on the average of both sides); on top lie hysteresis as of Coleman & Hodgdon
(1986), 2 % of the largest change wide, and what heals as a power of time. `held` is the share of
seeds whose 95 % interval holds 2, `bias` the mean error of k_res, `half` the median half width of
the interval, both relative, and `models` how often each was chosen.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable

import numpy as np

from defsense_fab.calibration.calibrate import calibrate
from defsense_fab.calibration.readings import Geometry, Memory, Piece, Readings
from defsense_fab.core.response import JIG_RADII_MM

TRUE = 2.0
_STEP, _READ = 30.0, 20.0  # s per jig, and after which it is read
_WIDE, _FOLLOWS = 0.02, 0.01  # of the largest change; strain in which hysteresis turns round
_HEALS, _POWER = 0.05, 0.4  # of a change that is added at first, and falls as a power of time
_NOISE = 0.001

RESPONSES: dict[str, Callable[[float], float]] = {
    "line": lambda e: 2 * e,
    "kink": lambda e: (2.4 if e > 0 else 1.6) * e,
    "cubic": lambda e: 2 * e + 4 * e**2 - 100 * e**3,
    "exponential": lambda e: 0.3 * (1 - np.exp(-e / 0.15)),
}


def session(
    response: Callable[[float], float], spread: float, rounds: int, rng: np.random.Generator
) -> Readings:
    """Readings of two specimens."""
    geometry, pieces, rows = Geometry(), [], []
    wide = _WIDE * max(abs(response(e)) for e in (-0.067, 0.067))
    for specimen in ("one", "two"):
        jigs = [
            (turn, face, radius)
            for turn in range(rounds)
            for face in (1, -1)
            for radius in (np.nan, *rng.permutation(JIG_RADII_MM))
        ]
        for place, side in (("top", 1), ("neutral", 0), ("bottom", -1)):
            pieces.append(Piece(specimen, place, side == 0))
            gain, rest, memory = 1 + spread * rng.normal(), rng.uniform(1500, 3000), Memory()
            before, lag, changes = 0.0, 0.0, []
            for k, (turn, face, radius) in enumerate(jigs):
                e = geometry.strain(radius, side * face)
                way = e - before
                # h' = |e'| (sign(e') - h) / follows
                keep = np.exp(-abs(way) / _FOLLOWS)
                lag = np.sign(way) * (1 - keep) + lag * keep
                changes.append((k * _STEP, abs(response(e) - response(before))))
                now = k * _STEP + _READ
                healing = sum(size * _HEALS * (1 + (now - at)) ** -_POWER for at, size in changes)
                value = response(e) - wide * lag + healing + _NOISE * rng.normal()
                past = memory.at(e, k * _STEP, now)
                rows.append((len(pieces) - 1, e, past, radius, turn, rest * (1 + gain * value)))
                before = e
    piece, strain, memory_, radius, turn, ohm = (np.array(c) for c in zip(*rows, strict=True))
    where = tuple(f"row {i}" for i in range(len(rows)))
    return Readings(tuple(pieces), piece, strain, memory_, radius, turn, ohm, where)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--draws", type=int, default=100, help="of the bootstrap")
    options = parser.parse_args()
    sys.stdout.write(f"{'':20}{'held':>7}{'bias':>8}{'half':>8}  models\n")
    for name, response in RESPONSES.items():
        for spread in (0.03, 0.06):
            held, error, half, models = [], [], [], Counter[str]()
            for seed in range(options.seeds):
                rng = np.random.default_rng((seed, 7))
                found = calibrate(
                    session(response, spread, options.rounds, rng), draws=options.draws
                )
                low, high = found.doubt.interval
                held.append(low <= TRUE <= high)
                error.append(found.k_res / TRUE - 1)
                half.append((high - low) / 2 / TRUE)
                models[found.response.model] += 1
            chosen = ", ".join(f"{m} {n}" for m, n in models.most_common())
            sys.stdout.write(
                f"{name:12}{spread:6.0%}  {np.mean(held):7.0%}{np.mean(error):8.1%}"
                f"{np.median(half):8.1%}  {chosen}\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
