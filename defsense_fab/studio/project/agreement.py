"""Whose CAD scripts may run: they are programs, and a folder may come from anybody."""

from __future__ import annotations

import json
import os
from pathlib import Path

from platformdirs import user_config_path

from ...core.device.device import BodySpec
from ...core.storage.files import storage_errors, write_json
from ...geometry.bodies.script_source import ScriptText, read_script

_FILE = "agreed-scripts.json"


def config_folder() -> Path:
    """`DEFSENSE_CONFIG`, or the user's folder for settings: never a folder that came from
    elsewhere."""
    chosen = os.environ.get("DEFSENSE_CONFIG")
    return Path(chosen) if chosen else user_config_path("defsense-fab")


class Agreement:
    """What a person has agreed to, by the script's path and the hash of its text and of what it may
    import from its folder: a script that has changed is asked for again."""

    def __init__(self, trusted: bool = False) -> None:
        """Where the folder is `trusted`, nothing is asked."""
        self.trusted = trusted
        self._here: dict[str, str] = {}  # where the user's folder cannot be written

    def asked(self, spec: BodySpec) -> ScriptText | None:
        """The script to which a person must agree before the body is made; None where that is not
        needed. Raises BodyError where it cannot be read."""
        if self.trusted or spec.kind != "script":
            return None
        script = read_script(spec.path)
        key, told = _key(script), script.digest
        return None if told in (self._here.get(key), _kept().get(key)) else script

    def give(self, script: ScriptText) -> None:
        """A person agrees to this text. Raises StorageError where that cannot be kept; it holds
        until the program ends."""
        self._here[_key(script)] = script.digest
        path = config_folder() / _FILE
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_json(path, {**_kept(), _key(script): script.digest})


def _key(script: ScriptText) -> str:
    return str(script.path.resolve())


def _kept() -> dict[str, str]:
    """Nothing where there is none that can be read: it is asked again then."""
    try:
        found = json.loads((config_folder() / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
