"""Run a body script in a child process, and record which files it reads.

The child is `python -m` this module with a folder that holds `TASK`. It leaves the solids in
`SOLIDS` and then, in `RESULT`, the files that the script read, or its error.
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

from ...core.device.device import BodySpec
from ...core.errors import BodyError
from ...core.machine.child_process import (
    ChildFailure,
    ChildLimits,
    error_from_record,
    error_record,
    run_module,
    start_child,
)
from ...core.machine.optional_libraries import missing, missing_code
from ...core.storage.files import digest, write_json
from ..kernels.loading import load_kernel_meanwhile

_WRITE_FLAGS = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND
#: Without /run itself: users' drives are mounted in /run/media.
_SYSTEM_FOLDERS = ("/dev", "/etc", "/proc", "/run/user", "/sys", "/usr", "/Library", "/System")
_USER_FOLDERS = (".cache", ".config", ".local", "Library")  # settings and caches in the home folder


@dataclass(frozen=True)
class SourceFile:
    """A file that a body was made from.

    Attributes:
        path: The file.
        content: Hash of its content; None if there was nothing to read.
    """

    path: Path
    content: str | None

    @classmethod
    def from_path(cls, path: Path) -> SourceFile:
        """Return the file in its present state."""
        try:
            return cls(path, digest(path))
        except OSError:
            return cls(path, None)


class OpenedFiles:
    """An audit hook (`sys.addaudithook`) that records which files are opened for reading.

    Each file is hashed when it is opened. Files of Python, of installed packages, of the system and
    of the user's caches do not count, nor do files that the script wrote first. Missing files count
    only inside `folder`. Files that native code opens itself are not noticed.

    Attributes:
        files: Recorded files by absolute path.
        is_active: Whether openings are recorded.
    """

    def __init__(self, folder: Path) -> None:
        self.files: dict[str, SourceFile] = {}
        self.is_active = True
        self._folder = os.path.realpath(folder)
        self._library_folders = _library_folders()
        self._written: set[str] = set()
        self._thread_state = threading.local()

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        if not self.is_active or getattr(self._thread_state, "is_recording", False):
            return
        if event == "open":
            name, _, flags = args
            if flags & _WRITE_FLAGS:
                self._record_write(name)
            else:
                self._record_read(name)
        elif event == "import":
            self._record_read(args[1])  # None but for extension modules
        elif event == "os.rename":
            self._record_write(args[1])

    def _record_write(self, name: Any) -> None:
        path = _absolute(name)
        if path and (path not in self.files or self.files[path].content is None):
            self.files.pop(path, None)
            self._written.add(path)

    def _record_read(self, name: Any) -> None:
        path = _absolute(name)
        if not path or path in self.files or path in self._written:
            return
        self._thread_state.is_recording = True  # hashing the file raises an event too
        try:
            real = os.path.realpath(path)
            if self._is_relevant(real) and not os.path.isdir(real):
                file = SourceFile.from_path(Path(path))
                if file.content is not None or _is_within(real, self._folder):
                    self.files[path] = file
        finally:
            self._thread_state.is_recording = False

    def _is_relevant(self, path: str) -> bool:
        """Whether a file counts. A library folder that holds the script's own folder, as /usr may,
        does not exclude the script's files.
        """
        inside = _is_within(path, self._folder)
        return not any(
            _is_within(path, root) and not (inside and _is_within(self._folder, root))
            for root in self._library_folders
        )


def _absolute(name: Any) -> str | None:
    """Return the path of a file that an event names; for bytecode, that of its source."""
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


def _library_folders() -> tuple[str, ...]:
    """Return folders whose files belong to installed software, not to the user's work."""
    folders = [sys.prefix, sys.base_prefix, sys.exec_prefix, *_SYSTEM_FOLDERS]
    folders += [p for k, p in sysconfig.get_paths().items() if k in ("stdlib", "platstdlib")]
    folders += [*site.getsitepackages(), site.getusersitepackages()]
    folders += [os.path.join(os.path.expanduser("~"), name) for name in _USER_FOLDERS]
    folders.append(
        str(Path(__file__).resolve().parents[2])
    )  # this package, if run from its sources
    return tuple(dict.fromkeys(os.path.realpath(f) for f in folders))


def _is_within(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)


MAX_MESSAGE_LENGTH = 300  # characters; CAD kernels list all their signatures
_SIGNATURES = re.compile(r"The following argument types are supported:.*?Invoked with:")
_ADDRESS = re.compile(r"<(?:\w+\.)*(\w+) object at 0x[0-9a-f]+>")


def script_error(raised: Mapping[str, Any], parameters: Mapping[str, Any]) -> BodyError:
    """Return the error for a script that raised an exception.

    Args:
        raised: The exception's `type`, `message` and `module` (of an ImportError), and the `file`
            and `line` (or None) where it was raised.
        parameters: Parameters that the script was called with.
    """
    line = raised["line"]
    where = f"{raised['file']}:{line}" if line else raised["file"]
    message = _clean_message(raised["message"])
    if raised["type"] == "SystemExit":
        status = f" ({message})" if message not in ("", "None") else ""
        return BodyError(
            f"the script ends the program{status} instead of returning a body",
            code="script-exits",
            where=where,
            action="Remove that call, or raise an error that says what is wrong",
            line=line,
        )
    if raised.get("module"):
        return _missing_library(where, line, str(raised["module"]), raised["type"], message)
    if not message:
        is_kernel_error = raised["type"].startswith(("Standard_", "StdFail_", "gp_"))
        message = "no message"
        if is_kernel_error:
            message = "the CAD kernel accepts no size of zero or less, and no empty shape"
    given = ", ".join(f"{name} = {value}" for name, value in parameters.items())
    return BodyError(
        f"the script raised {raised['type']}: {message}",
        code="script-raises",
        where=where,
        action=f"Fix the script or its parameters{f' ({given})' if given else ''}",
        line=line,
        exception=raised["type"],
        message=message,
    )


def _missing_library(
    where: str, line: int | None, module: str, kind: str, message: str
) -> BodyError:
    """Return the error for a library that is not installed or does not load."""
    error: ImportError
    if kind != ModuleNotFoundError.__name__:
        error = ImportError(message, name=module)
        text = missing(where, error)
    else:
        error = ModuleNotFoundError(name=module)
        if module.partition(".")[0] == "cadquery":
            text = missing(where, error, "cadquery")
        else:
            text = missing(where, error, otherwise="or put what the script imports into its folder")
    return BodyError(text, code=missing_code(error), line=line, module=module)


def _clean_message(message: str) -> str:
    """Remove the signatures and addresses that bindings of CAD kernels print."""
    text = _ADDRESS.sub(r"\1", _SIGNATURES.sub("It was given", message))
    return text if len(text) <= MAX_MESSAGE_LENGTH else text[: MAX_MESSAGE_LENGTH - 3] + "..."


TASK, SOLIDS, RESULT = "task.json", "solids.brep", "result.json"
_NO_FUNCTION = object()


def run_script(spec: BodySpec) -> tuple[list[Any], tuple[SourceFile, ...]]:
    """Run a body script in a child process and return its solid or surfaces.

    What the script prints goes to standard error.

    Args:
        spec: The `[body]` section, whose kind is "script".

    Returns:
        The pieces (see `brep.pieces_of`) of `body(**parameters)`, and the files that the script
        read.

    Raises:
        BodyError: If the script fails, takes too long, or returns no solid.
    """
    path = spec.path
    failure = ChildFailure(
        BodyError,
        str(path),
        "the script",
        "Find the call that ends it",
        "Simplify the script, or raise [body] time_limit in device.toml",
    )

    def write_task(folder: Path) -> None:
        task = {"script": str(path), "parameters": dict(spec.parameters)}
        (folder / TASK).write_text(json.dumps(task, default=_to_json), encoding="utf-8")

    module = f"{__package__}.script_process"
    limits = ChildLimits.of_cpu_time(spec.time_limit)
    # Both processes need the CAD kernel: this one loads it while the script runs.
    with (
        load_kernel_meanwhile("occ") as wait_for_brep,
        run_module(module, write_task, RESULT, limits, failure, relay=True) as folder,
    ):
        result = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        if "error" in result:
            raise error_from_record(BodyError, result["error"], where=str(path))
        if "type" in result:
            raise script_error(result, spec.parameters)
        solids = wait_for_brep().read_brep(folder / SOLIDS)
    sources = tuple(SourceFile(Path(name), content) for name, content in result["sources"])
    # A file that no longer exists was a temporary file of the script.
    return solids, tuple(s for s in sources if s.content is None or s.path.exists())


def _to_json(value: Any) -> Any:
    """Convert a NumPy number for JSON, or raise BodyError for a type that JSON does not have."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise BodyError(
        f"cannot hold {value!r}",
        code="unsupported-parameter",
        where="device.toml: body.parameters",
        action="Use numbers, texts, lists or tables",
    )


def main(folder: Path) -> None:
    """Run the script of the task in `folder` and write its solids or its error there."""
    start_child()
    task = json.loads((folder / TASK).read_text(encoding="utf-8"))
    path = Path(task["script"])
    opened_files = OpenedFiles(path.parent)
    sys.addaudithook(opened_files)
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
        opened_files.is_active = False
        outcome = _save(result, folder / SOLIDS)
        outcome["sources"] = [[str(f.path), f.content] for f in opened_files.files.values()]
    write_json(folder / RESULT, outcome)


def _call(path: Path, parameters: dict[str, Any]) -> Any:
    """Return the result of the script's `body(**parameters)`, or `_NO_FUNCTION`."""
    module = ModuleType("__body__")
    module.__file__ = str(path)
    sys.modules["__body__"] = module
    sys.path.insert(0, str(path.parent.absolute()))
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), vars(module))  # noqa: S102 - the user's own script
    body = getattr(module, "body", None)
    return body(**parameters) if callable(body) else _NO_FUNCTION


def _save(result: Any, target: Path) -> dict[str, Any]:
    """Write what bounds the body to `target`, or return the error if the result bounds none."""
    try:
        if result is _NO_FUNCTION:
            raise BodyError(
                "defines no function body(...)",
                code="no-body-function",
                action="Add one that returns a solid",
            )
        from ..kernels import brep
        from .script_result import pieces_from_result

        brep.write_brep(pieces_from_result(result), target)
    except BodyError as error:
        return {"error": error_record(error)}
    return {}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
