"""A body's script in a process of its own: `python -m` this module, with a folder.

The folder holds `TASK`. The module leaves the solids in `SOLIDS` and, last, the files that the
script read, or its error, in `RESULT`.
"""

from __future__ import annotations

import json
import os
import re
import site
import sys
import sysconfig
import threading
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import source_from_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from ...core.errors import BodyError
from ...core.machine.optional_libraries import missing
from ...core.storage.files import digest, write_json
from .child_process import end_with_parent

# Which of the user's files a body was made from: what its script opens and imports.

_CREATES = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
#: Not /run itself: drives of users are mounted in /run/media.
_SYSTEM = ("/dev", "/etc", "/proc", "/run/user", "/sys", "/usr", "/Library", "/System")
_USERS_OWN = (".cache", ".config", ".local", "Library")  # in the home folder: settings and caches


@dataclass(frozen=True)
class SourceFile:
    """A file and the hash of its content; None where there was none to read."""

    path: Path
    content: str | None

    @classmethod
    def now(cls, path: Path) -> SourceFile:
        """The file as it is."""
        try:
            return cls(path, digest(path))
        except OSError:
            return cls(path, None)


class OpenedFiles:
    """An audit hook (`sys.addaudithook`) that keeps which files were opened for reading, and their
    hashes at that time. Files of Python, of installed packages, of the system and of the user's
    caches do not count, nor do those that were written first. Files that were not there count in
    `folder`. What native code opens by itself is not seen."""

    def __init__(self, folder: Path) -> None:
        self.found: dict[str, SourceFile] = {}
        self.active = True
        self._folder = os.path.realpath(folder)
        self._libraries = _libraries()
        self._written: set[str] = set()
        self._own = threading.local()

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        if not self.active or getattr(self._own, "busy", False):
            return
        if event == "open":
            name, _, flags = args
            if flags & _CREATES:
                self._wrote(name)
            else:
                self._read(name)
        elif event == "import":
            self._read(args[1])  # None but for extension modules
        elif event == "os.rename":
            self._wrote(args[1])

    def _wrote(self, name: Any) -> None:
        path = _absolute(name)
        if path and (path not in self.found or self.found[path].content is None):
            self.found.pop(path, None)
            self._written.add(path)

    def _read(self, name: Any) -> None:
        path = _absolute(name)
        if not path or path in self.found or path in self._written:
            return
        self._own.busy = True  # reading it here is an event too
        try:
            real = os.path.realpath(path)
            if self._counts(real) and not os.path.isdir(real):
                file = SourceFile.now(Path(path))
                if file.content is not None or _within(real, self._folder):
                    self.found[path] = file
        finally:
            self._own.busy = False

    def _counts(self, path: str) -> bool:
        """A library's folder may hold the script's, as /usr may; it does not count as one then."""
        inside = _within(path, self._folder)
        return not any(
            _within(path, root) and not (inside and _within(self._folder, root))
            for root in self._libraries
        )


def _absolute(name: Any) -> str | None:
    """The path of a file that an event names; of bytecode, that of its source."""
    if not isinstance(name, str | bytes | os.PathLike):
        return None  # a descriptor
    path = os.path.abspath(os.fsdecode(name))
    if "\0" in path:
        return None
    if path.endswith(".pyc"):
        try:
            return source_from_cache(path)
        except ValueError:
            return None
    return path


def _libraries() -> tuple[str, ...]:
    """Folders whose files belong to what is installed, not to the user's work."""
    folders = [sys.prefix, sys.base_prefix, sys.exec_prefix, *_SYSTEM]
    folders += [p for k, p in sysconfig.get_paths().items() if k in ("stdlib", "platstdlib")]
    folders += [*site.getsitepackages(), site.getusersitepackages()]
    folders += [os.path.join(os.path.expanduser("~"), name) for name in _USERS_OWN]
    folders.append(str(Path(__file__).resolve().parents[2]))  # this package, run from its sources
    return tuple(dict.fromkeys(os.path.realpath(f) for f in folders))


def _within(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)


# What a body's script raised, as one sentence that its user can act on.

_LONGEST = 300  # characters of a message; CAD kernels list every signature that they have
_SIGNATURES = re.compile(r"The following argument types are supported:.*?Invoked with:")
_ADDRESS = re.compile(r"<(?:\w+\.)*(\w+) object at 0x[0-9a-f]+>")


def script_failure(raised: Mapping[str, Any], parameters: Mapping[str, Any]) -> BodyError:
    """The error of a script that raised: `type`, `message`, and the `file` and `line` (or None)
    where it did; `parameters` are those that it was called with."""
    where = f"{raised['file']}:{raised['line']}" if raised["line"] else raised["file"]
    message = _plain(raised["message"])
    if raised["type"] == "SystemExit":
        said = f" ({message})" if message not in ("", "None") else ""
        return BodyError(
            f"{where}: the script ends the program{said} in place of returning a body; remove that"
            " call, or raise an error that says what is wrong",
            code="script-exits",
            line=raised["line"],
        )
    if raised.get("module"):
        return BodyError(
            _missing(where, str(raised["module"]), raised["type"], message),
            code="missing-library",
            line=raised["line"],
            module=raised["module"],
        )
    if not message:
        kernel = raised["type"].startswith(("Standard_", "StdFail_", "gp_"))
        message = "no message"
        if kernel:
            message = "the CAD kernel takes no size that is zero or negative, and no empty shape"
    given = ", ".join(f"{name} = {value}" for name, value in parameters.items())
    return BodyError(
        f"{where}: the script raised {raised['type']}: {message}; mend the script or its"
        f" parameters{f' ({given})' if given else ''}",
        code="script-raises",
        line=raised["line"],
        exception=raised["type"],
        message=message,
    )


def _missing(where: str, module: str, kind: str, message: str) -> str:
    """A library that is not installed, or does not load."""
    if kind != ModuleNotFoundError.__name__:
        return missing(where, ImportError(message, name=module))
    error = ModuleNotFoundError(name=module)
    if module.partition(".")[0] == "cadquery":
        return missing(where, error, "cadquery")
    return missing(where, error, otherwise="or put what the script imports into its folder")


def _plain(message: str) -> str:
    """Without the signatures and addresses that bindings of CAD kernels print."""
    text = _ADDRESS.sub(r"\1", _SIGNATURES.sub("It was given", message))
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


TASK, SOLIDS, RESULT = "task.json", "solids.brep", "result.json"
_MISSING = object()


def main(folder: Path) -> None:
    """Run the script of the task, and write what came of it."""
    end_with_parent()
    task = json.loads((folder / TASK).read_text(encoding="utf-8"))
    path = Path(task["script"])
    opened = OpenedFiles(path.parent)
    sys.addaudithook(opened)
    outcome: dict[str, Any]
    try:
        result = _call(path, task["parameters"])
    except BaseException as error:  # scripts may raise anything, or call exit()
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        outcome = {
            "file": str(path),
            "line": frames[-1].lineno if frames else getattr(error, "lineno", None),
            "type": type(error).__name__,
            "message": " ".join(str(error).split()),
            "module": error.name if isinstance(error, ImportError) else None,
        }
    else:
        opened.active = False
        outcome = _save(result, folder / SOLIDS)
        outcome["sources"] = [[str(f.path), f.content] for f in opened.found.values()]
    write_json(folder / RESULT, outcome)


def _call(path: Path, parameters: dict[str, Any]) -> Any:
    """What `body(**parameters)` of the script returns, or `_MISSING`."""
    module = ModuleType("__body__")
    module.__file__ = str(path)
    sys.modules["__body__"] = module
    sys.path.insert(0, str(path.parent.absolute()))
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), vars(module))  # noqa: S102 - the user's own script
    body = getattr(module, "body", None)
    return body(**parameters) if callable(body) else _MISSING


def _save(result: Any, target: Path) -> dict[str, Any]:
    """Write the solids, or say why what the script returned has none."""
    if result is _MISSING:
        return {
            "refused": "defines no function body(...); add one that returns a solid",
            "code": "no-body-function",
            "data": {},
        }
    if result is None:
        return {
            "refused": "body() returned None; return the solid",
            "code": "not-a-solid",
            "data": {"type": "NoneType"},
        }
    from ..kernels import brep, occ

    try:
        brep.write_brep(occ.solids_of(result), target)
    except BodyError as error:
        return {"refused": str(error), "code": error.code, "data": error.data}
    return {}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
