"""Findings of checks, calls in a separate process, and commands that install system libraries."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from typing import Any, Literal

from ...core.machine.processes import NEW_GROUP, kill_group

Status = Literal["good", "missing", "not needed"]

# Prefix of the project's own errors in a traceback; their messages are complete without it.
_ERROR_CLASS = re.compile(r"^defsense_fab\.core\.errors\.\w+: ")
# Hint of errors to run `defsense doctor`, which is running already.
_DOCTOR_HINT = re.compile(r"(?:, or|[.,;])? ?\(?[Rr]un '?defsense doctor'? for details\)?\.?$")
#: Start of the trouble of a call that did not end in time.
HANGS = "hangs"
_ANSWER = "defsense-doctor-answer:"
_CALL = f"""
import importlib, json, sys
found = getattr(importlib.import_module(sys.argv[1]), sys.argv[2])(*sys.argv[3:])
sys.stdout.write("\\n{_ANSWER}" + json.dumps(found) + "\\n")
sys.stdout.flush()
import os
os._exit(0)  # a library that crashes while Python ends has passed the check
"""

#: Installs the libraries that drawing and cutting load, even without a screen.
GRAPHICS = "sudo apt-get install libgl1 libegl1 libxrender1"
_SYSTEM_PACKAGES = {
    "libGL.so": GRAPHICS,
    "libEGL.so": GRAPHICS,
    "libXrender.so": GRAPHICS,
    "libasound.so": "sudo apt-get install libasound2",
}


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    Attributes:
        check: Group of the check.
        about: What was checked.
        status: `good`, `missing`, or `not needed` if only some users need it.
        told: The result in words.
        command: Command that fixes it.
        needed_for: What it is needed for; required if it is not needed by all users.
        core: Whether all users need it.

    Raises:
        ValueError: The status does not fit the other fields.
    """

    check: str
    about: str
    status: Status
    told: str
    command: str = ""
    needed_for: str = ""
    core: bool = False

    def __post_init__(self) -> None:
        if self.status == "not needed" and not self.needed_for:
            raise ValueError(f"{self.about}: a finding that is not needed must name its use")
        if self.status == "not needed" and self.core:
            raise ValueError(f"{self.about}: a finding of the core must be good or missing")


def make_finding(
    check: str,
    about: str,
    good: bool,
    text: str,
    *,
    command: str = "",
    needed_for: str = "",
) -> Finding:
    """Return a finding.

    Args:
        check: Group of the check.
        about: What was checked.
        good: Whether the check was passed.
        text: The result in words.
        command: Command that fixes it.
        needed_for: What it is needed for; empty for the core. A failed check of the core is
            `missing`, others are `not needed`.
    """
    core = not needed_for
    if good:
        return Finding(check, about, "good", text, core=core)
    status: Status = "missing" if core else "not needed"
    return Finding(check, about, status, text, command, needed_for, core)


def system_command(trouble: str) -> str:
    """Return the command that installs a missing system library.

    Args:
        trouble: Message of a failed import.

    Returns:
        The command; empty for other troubles, and on systems without apt.
    """
    if sys.platform != "linux":
        return ""
    return next((command for name, command in _SYSTEM_PACKAGES.items() if name in trouble), "")


@dataclass(frozen=True)
class Answer:
    """The result of a call in a separate process.

    Attributes:
        value: What the function returned.
        trouble: Why it did not return, in words; else empty.
    """

    value: Any = None
    trouble: str = ""


def call(module: str, function: str, *words: str, seconds: float) -> Answer:
    """Call a function in a new process, which may crash or hang.

    Args:
        module: Name of the module.
        function: Name of the function; its result must be valid in JSON.
        words: Its arguments.
        seconds: Time limit, s.
    """
    command = [sys.executable, "-c", _CALL, module, function, *words]
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8"}
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
        encoding="utf-8",
        errors="replace",
        **NEW_GROUP,
    )
    try:
        out, err = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        _kill(process)
        return Answer(trouble=f"{HANGS}: no answer within {seconds:g} s")
    except BaseException:
        _kill(process)
        raise
    _, marker, result = out.rpartition(_ANSWER)
    if process.returncode == 0 and marker:
        return Answer(json.loads(result))
    return Answer(trouble=_explain_failure(process.returncode, err))


def _kill(process: subprocess.Popen[str]) -> None:
    """Kill a process with its children, which would keep its pipes open."""
    kill_group(process.pid)
    process.communicate()


def _explain_failure(code: int, err: str) -> str:
    if code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        return f"crashes ({name})"
    lines = [line.strip() for line in err.splitlines() if line.strip()]
    last = _ERROR_CLASS.sub("", lines[-1]) if lines else f"ends with code {code}"
    return _DOCTOR_HINT.sub("", last)
