"""A body's script as text: what may run when the body is made."""

from __future__ import annotations

import ast
import hashlib
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import BodyError

#: What Python imports.
_SUFFIXES = (".py", ".pyc", ".so", ".pyd")


@dataclass(frozen=True)
class ScriptText:
    """The script at `path`, and the programs beside it, by their names in its folder."""

    path: Path
    files: tuple[tuple[str, bytes], ...]

    @property
    def digest(self) -> str:
        """SHA-256 of all files with their names."""
        whole = hashlib.sha256()
        for name, content in self.files:
            for part in (name.encode(errors="surrogateescape"), content):
                whole.update(len(part).to_bytes(8, "little") + part)
        return whole.hexdigest()


def read_script(path: Path) -> ScriptText:
    """The script first, then whatever else may run with it: what it imports from its own folder,
    and what lies there by a name that any library may import, as its folder is searched first.
    Raises BodyError where it cannot be read."""
    try:
        files = {path.name: path.read_bytes()}
        waiting = [path.name, *_importable(path.parent)]
    except OSError as error:
        raise BodyError(
            f"{path}: cannot be read: {error.strerror}; give another script", code="file-unreadable"
        ) from None
    while waiting:
        name = waiting.pop()
        if name not in files:
            try:
                files[name] = (path.parent / name).read_bytes()
            except OSError:
                continue  # an import will not find it either
        waiting += [n for n in _imported(path.parent, name, files[name]) if n not in files]
    first = (path.name, files.pop(path.name))
    return ScriptText(path, (first, *sorted(files.items())))


def _importable(folder: Path) -> list[str]:
    """Modules that lie in the folder, and packages with all that is in them."""
    found = []
    for entry in folder.iterdir():
        if entry.suffix in _SUFFIXES and entry.is_file():
            found.append(entry.name)
        elif any((entry / f"__init__{suffix}").is_file() for suffix in _SUFFIXES):
            inside = [p for p in entry.rglob("*") if p.suffix in _SUFFIXES and p.is_file()]
            found += [p.relative_to(folder).as_posix() for p in inside]
    return found


def _imported(folder: Path, importer: str, content: bytes) -> list[str]:
    """Files of the folder that the text of `importer` imports; none of what is no Python."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError):
        return []
    modules = set[Path]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {Path(*alias.name.split(".")) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parents = Path(importer).parents
            base = parents[min(node.level, len(parents)) - 1] if node.level else Path()
            place = base.joinpath(*(node.module or "").split("."))
            modules |= {place, *(place / alias.name for alias in node.names)}
    found = []
    for module in modules:
        places = (module, *module.parents)[:-1]
        names = [n for p in places for n in (p / "__init__.py", p.parent / f"{p.name}.py")]
        found += [n.as_posix() for n in names if (folder / n).is_file()]
    return sorted(found)
