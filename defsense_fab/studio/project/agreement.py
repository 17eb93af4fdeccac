"""The scripts that the user has agreed to run.

Scripts are programs, and a folder may come from anybody. Agreements are therefore never read from a
device's folder.
"""

from __future__ import annotations

import json

from ...core.device.device import BodySpec
from ...core.storage.files import config_folder, storage_errors, write_json
from ...workflow.starts.body_scripts import ScriptText, read_script

_FILE = "agreed-scripts.json"


class Agreement:
    """The user's agreements, stored by script path and content hash.

    The hash includes the files that the script may import from its folder. A changed script needs
    a new agreement.

    Args:
        trusted: Whether all scripts may run without asking.
    """

    def __init__(self, trusted: bool = False) -> None:
        self.trusted = trusted
        self._session: dict[str, str] = {}  # holds if the user's folder cannot be written

    def script_to_confirm(self, spec: BodySpec) -> ScriptText | None:
        """Return the script that the user must agree to before the body is made.

        Returns:
            The script, or None if no agreement is needed.

        Raises:
            BodyError: The script cannot be read.
        """
        if self.trusted or spec.kind != "script":
            return None
        script = read_script(spec.path)
        key = _key(script)
        is_agreed = script.digest in (self._session.get(key), _read_stored().get(key))
        return None if is_agreed else script

    def confirm(self, script: ScriptText) -> None:
        """Store the user's agreement to this text.

        Raises:
            StorageError: The agreement cannot be stored; it holds until the program ends.
        """
        self._session[_key(script)] = script.digest
        path = config_folder() / _FILE
        with storage_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_json(path, {**_read_stored(), _key(script): script.digest})


def _key(script: ScriptText) -> str:
    return str(script.path.resolve())


def _read_stored() -> dict[str, str]:
    """Return the stored agreements; none if the file is missing or cannot be read."""
    try:
        content = json.loads((config_folder() / _FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
