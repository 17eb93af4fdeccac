"""Run one peer in this interpreter.

    python -m benchmarks.peers.run PEER problem.npz result.npz --increments N

The result contains u (n, 3) mm and stats (JSON). If the peer does not converge, the exit code is 1
and stderr has the reason.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from pathlib import Path

import numpy as np

from benchmarks.peers.problem import load

PEERS = ("felupe", "ngsolve", "calculix")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("peer", choices=PEERS)
    parser.add_argument("problem", type=Path)
    parser.add_argument("result", type=Path)
    parser.add_argument("--increments", type=int, default=1, help="equal load increments")
    parser.add_argument("--folder", type=Path, help="where CalculiX leaves its files")
    options = parser.parse_args()
    peer = importlib.import_module(f"benchmarks.peers.{options.peer}_peer")
    try:
        u, stats = peer.solve(
            **load(options.problem), increments=options.increments, folder=options.folder
        )
    except RuntimeError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    np.savez(options.result, u=u, stats=json.dumps(stats))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
