"""The sessions on specimens of the cord in a device's folder."""

from __future__ import annotations

import json
from pathlib import Path

from ....core.storage.files import read_regular
from ....core.storage.session_manifest import FILE

RESPONSE_FILE = "response.json"
#: Start of the names of the folders of simulated specimens.
SIMULATED_PREFIX = "specimen-twin"


def specimen_sessions(folder: Path) -> list[Path]:
    """Return the sessions on specimens in a folder and in its subfolders, sorted by path."""
    sessions = []
    for path in sorted([*folder.glob(f"*/{FILE}"), *folder.glob(f"*/*/{FILE}")]):
        try:
            manifest = json.loads(read_regular(path))
        except (OSError, ValueError):  # damaged, whatever kind of session it is
            continue
        if isinstance(manifest, dict) and "specimen" in manifest:
            sessions.append(path.parent)
    return sessions
