"""Follow the guides of built devices literally, and print each impossible step.

    python -m tests.support.follow_guide DIR...

The steps of `build/guide.json` are followed, and must appear in `guide.html` in the same order. The
exit code is 1 if a step is impossible.
"""

from __future__ import annotations

import html
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from defsense_fab.core.device.device import Device
from defsense_fab.core.device.device_file import load_device

from .assembler import Assembler


def follow_steps(guide: dict[str, Any], assembler: Assembler) -> list[str]:
    """Return the complaints about a guide."""
    for step in guide["steps"]:
        for action in step["actions"]:
            assembler.perform(step["number"], action)
    return assembler.finish()


def compare_page(guide: dict[str, Any], page: str) -> list[str]:
    """Return sentences of the guide that the page lacks, or has in another order."""
    lines = [line for s in guide["steps"] for a in s["actions"] for line in a["lines"]]
    items = [html.unescape(x) for x in re.findall(r"<li>(.*?)</li>", page, re.S)]
    if items == lines:
        return []
    wrong = next((k for k, (a, b) in enumerate(zip(items, lines, strict=False)) if a != b), -1)
    return [f"guide.html differs from guide.json from sentence {wrong + 1}"]


def follow(build: Path, device: Device) -> list[str]:
    """Return the complaints about the guide in a device's build folder."""
    guide, manifest, layout = (
        json.loads((build / name).read_text(encoding="utf-8"))
        for name in ("guide.json", "parts/manifest.json", "layout.json")
    )
    parts = {
        p["name"]: np.asarray(trimesh.load_mesh(build / "parts" / p["stl"]).triangles)
        for p in manifest["parts"]
    }
    assembler = Assembler(
        manifest, layout, parts, device.cord.ferrule_length, device.cord.max_strain
    )
    page = (build / "guide.html").read_text(encoding="utf-8")
    return follow_steps(guide, assembler) + compare_page(guide, page)


def main() -> int:
    failure_count = 0
    for folder in sys.argv[1:]:
        complaints = follow(Path(folder) / "build", load_device(Path(folder)))
        failure_count += bool(complaints)
        print(
            f"{folder}: {'can be followed' if not complaints else f'{len(complaints)} complaints'}"
        )
        for text in complaints:
            print(f"  {text}")
    return int(failure_count > 0)


if __name__ == "__main__":
    sys.exit(main())
