"""fTetWild in a process of its own: `python -m` this module, with IN.npz and OUT.npz.

In the caller's process it would take Ctrl-C away, and a crash on a bad surface would end the build
without a word.
"""

from __future__ import annotations

import sys

import numpy as np


def main(source: str, target: str) -> None:
    """Read vertices, faces, edge_length (mm) and epsilon; write nodes and tets, or the error."""
    import pytetwild

    with np.load(source) as given:
        try:
            nodes, tets = pytetwild.tetrahedralize(
                given["vertices"],
                given["faces"],
                edge_length_abs=float(given["edge_length"]),
                epsilon=float(given["epsilon"]),
                num_threads=1,
            )
        except RuntimeError as error:
            np.savez(target, error=str(error))
            return
    np.savez(target, nodes=nodes, tets=tets)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
