"""Findings of checks, and calls in a separate process, which may crash or hang."""

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

# Prefix of the project's own errors in a traceback; their messages are complete without it.
_ERROR_CLASS = re.compile(r"^defsense_fab\.core\.errors\.\w+: ")
# Hint of errors to run `defsense doctor`, which is running already.
_DOCTOR_HINT = re.compile(r"(?:, or|[.,;])? ?\(?[Rr]un '?defsense doctor'? for details\)?\.?$")
#: Start of the failure of a call that did not end in time.
HANGS = "hangs"
_ANSWER = "defsense-doctor-answer:"
_CALL = f"""
import importlib, json, sys
answer = getattr(importlib.import_module(sys.argv[1]), sys.argv[2])(*sys.argv[3:])
sys.stdout.write("\\n{_ANSWER}" + json.dumps(answer) + "\\n")
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
        is_good: Whether the check was passed.
        message: The result in words.
        command: Command that fixes it; empty if it is good or there is none.
        needed_for: The task that needs it; empty if all users do.
    """

    check: str
    about: str
    is_good: bool
    message: str
    command: str = ""
    needed_for: str = ""

    @property
    def status(self) -> Literal["good", "missing", "not needed"]:
        """The result in short; `not needed` is a failed check that only some users need."""
        if self.is_good:
            return "good"
        return "not needed" if self.needed_for else "missing"


def system_command(failure: str) -> str:
    """Return the command that installs a missing system library.

    Args:
        failure: Message of a failed import.

    Returns:
        The command; empty for other failures, and on systems without apt.
    """
    if sys.platform != "linux":
        return ""
    return next((command for name, command in _SYSTEM_PACKAGES.items() if name in failure), "")


@dataclass(frozen=True)
class Answer:
    """The result of a call in a separate process.

    Attributes:
        value: What the function returned.
        failure: Why it did not return, in words; else empty.
    """

    value: Any = None
    failure: str = ""


def call(module: str, function: str, *words: str, seconds: float) -> Answer:
    """Call a function in a new process, which may crash or hang.

    Args:
        module: Name of the module.
        function: Name of the function; its result must be valid in JSON.
        words: Its arguments.
        seconds: Time limit, s.
    """
    process = subprocess.Popen(
        [sys.executable, "-c", _CALL, module, function, *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
        encoding="utf-8",
        errors="replace",
        **NEW_GROUP,
    )
    try:
        out, err = process.communicate(timeout=seconds)
    except BaseException as error:
        kill_group(process.pid)  # with its children, which would keep its pipes open
        process.communicate()
        if not isinstance(error, subprocess.TimeoutExpired):
            raise
        return Answer(failure=f"{HANGS}: no answer within {seconds:g} s")
    _, marker, result = out.rpartition(_ANSWER)
    if process.returncode == 0 and marker:
        return Answer(json.loads(result))
    return Answer(failure=_explain_failure(process.returncode, err))


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
