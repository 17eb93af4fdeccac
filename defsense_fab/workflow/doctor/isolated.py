"""Functions called in a process of their own, within a time limit."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

from ...core.machine.processes import NEW_GROUP, kill_group

#: Its name before the message, which stands for itself.
_OWN_ERROR = re.compile(r"^defsense_fab\.core\.errors\.\w+: ")
#: How the words about a call begin that did not end in time.
HANGS = "hangs"
_ANSWER = "defsense-doctor-answer:"
_CALL = f"""
import importlib, json, sys
found = getattr(importlib.import_module(sys.argv[1]), sys.argv[2])(*sys.argv[3:])
sys.stdout.write("\\n{_ANSWER}" + json.dumps(found) + "\\n")
sys.stdout.flush()
import os
os._exit(0)  # a library that crashes while Python ends has done what was asked
"""


@dataclass(frozen=True)
class Answer:
    """What a function returned, or in words why it did not (`trouble`)."""

    value: Any = None
    trouble: str = ""


def call(module: str, function: str, *words: str, seconds: float) -> Answer:
    """`module.function(*words)` in a new process. What it returns goes through JSON."""
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
        _end(process)
        return Answer(trouble=f"{HANGS}: no answer within {seconds:g} s")
    except BaseException:
        _end(process)
        raise
    _, found, rest = out.rpartition(_ANSWER)
    if process.returncode == 0 and found:
        return Answer(json.loads(rest))
    return Answer(trouble=_why(process.returncode, err))


def _end(process: subprocess.Popen[str]) -> None:
    """The process and what it started: its children would keep its pipes open."""
    kill_group(process.pid)
    process.communicate()


def _why(code: int, err: str) -> str:
    if code < 0:
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        return f"crashes ({name})"
    lines = [line.strip() for line in err.splitlines() if line.strip()]
    last = _OWN_ERROR.sub("", lines[-1]) if lines else f"ends with code {code}"
    return last.removesuffix("; defsense doctor tells more")  # this is what does
