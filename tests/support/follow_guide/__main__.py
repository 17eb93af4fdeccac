"""Follow the guides of built devices literally, and tell of each step that cannot be done then.

    python -m tests.support.follow_guide DIR...

Reads `build/guide.json`, and looks for all that it says in `guide.html` in the same order and in
`guide.pdf`. Exit code 1 where something cannot be done.
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

from .hands import Hands


def followed(guide: dict[str, Any], hands: Hands) -> list[str]:
    """What could not be done of a guide."""
    for step in guide["steps"]:
        for action in step["actions"]:
            hands.do(step["number"], action)
    return hands.finish()


def said(guide: dict[str, Any], page: str) -> list[str]:
    """What the guide's steps say that the page does not, in the same order."""
    lines = [line for s in guide["steps"] for a in s["actions"] for line in a["lines"]]
    items = [html.unescape(x) for x in re.findall(r"<li>(.*?)</li>", page, re.S)]
    if items == lines:
        return []
    wrong = next((k for k, (a, b) in enumerate(zip(items, lines, strict=False)) if a != b), -1)
    return [f"guide.html says something else than guide.json from sentence {wrong + 1} on"]


def printed(guide: dict[str, Any], path: Path) -> list[str]:
    """What the guide's steps say that the PDF does not."""
    import pypdfium2

    document = pypdfium2.PdfDocument(path)
    pages = [page.get_textpage() for page in document]
    text = "".join(re.sub(r"[\W\d_]+", "", t.get_text_range()) for t in pages)
    for page in pages:
        page.close()
    document.close()
    lines = [line for s in guide["steps"] for a in s["actions"] for line in a["lines"]]
    return [f"guide.pdf lacks: {x}" for x in lines if re.sub(r"[\W\d_]+", "", x) not in text]


def follow(build: Path, device: Device) -> list[str]:
    """What could not be done of the guide in a device's folder of results."""
    guide, manifest, layout = (
        json.loads((build / name).read_text(encoding="utf-8"))
        for name in ("guide.json", "parts/manifest.json", "layout.json")
    )
    parts = {
        p["name"]: np.asarray(trimesh.load_mesh(build / "parts" / p["stl"]).triangles)
        for p in manifest["parts"]
    }
    hands = Hands(manifest, layout, parts, device.cord.ferrule_length, device.cord.max_strain)
    page = (build / "guide.html").read_text(encoding="utf-8")
    return followed(guide, hands) + said(guide, page) + printed(guide, build / "guide.pdf")


def main() -> int:
    bad = 0
    for folder in sys.argv[1:]:
        found = follow(Path(folder) / "build", load_device(Path(folder)))
        bad += bool(found)
        print(f"{folder}: {'can be followed' if not found else f'{len(found)} complaints'}")
        for text in found:
            print(f"  {text}")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
