"""`model.json`: a trained model as plain numbers, which any program reads (docs/model.md).

A hash of its content tells a file that was cut off, or edited: what moves a character or plays an
organ should not do so by half a matrix.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import msgspec

from ...core.errors import TrainingError
from ...core.storage import typed_json
from ...core.storage.files import load_json, write_text
from ...decoding.trained_model import TrainedModel

MODEL = "model.json"
_TAIL = 100  # bytes at a model's end, that its hash is in
_REMEDY = "'defsense train' writes such a file"


def write_model(path: Path, model: TrainedModel) -> None:
    """Raises StorageError."""
    data = {"schema": model.SCHEMA, **typed_json.to_json(model)}
    write_text(path, _text({**data, "sha256": _hash(data)}) + "\n")


def is_model(path: Path) -> bool:
    """Whether a file seems to be a whole model, by its end: as quick as many files need it."""
    try:
        with path.open("rb") as file:
            file.seek(-min(_TAIL, path.stat().st_size), 2)
            return b'"sha256":' in file.read()
    except OSError:
        return False


def load_model(path: Path) -> TrainedModel:
    """Of a file, or of the folder that holds it. Raises TrainingError for what is no whole model
    as it was written."""
    path = path / MODEL if path.is_dir() else path
    try:
        data = load_json(path, TrainingError, _REMEDY)
    except RecursionError:
        raise TrainingError(f"{path}: is no trained model; {_REMEDY}") from None
    if not isinstance(data, dict) or "sha256" not in data:
        raise TrainingError(f"{path}: is no trained model; {_REMEDY}")
    if data.pop("schema", None) != TrainedModel.SCHEMA:
        raise TrainingError(
            f"{path}: this version reads schema {TrainedModel.SCHEMA}; train the model again"
        )
    told = data.pop("sha256")
    try:
        whole = _hash({"schema": TrainedModel.SCHEMA, **data}) == told
    except ValueError:  # numbers that are none
        whole = False
    if not whole:
        raise TrainingError(
            f"{path}: was changed after it was written (its hash does not fit); take a copy that"
            " was not, or train the model again"
        )
    try:
        return typed_json.from_json(data, TrainedModel)
    except msgspec.ValidationError as problem:
        raise TrainingError(f"{path}: is damaged ({problem}); train the model again") from None


def _hash(data: dict[str, Any]) -> str:
    return hashlib.sha256(_text(data).encode()).hexdigest()


def _text(data: dict[str, Any]) -> str:
    """Numbers as they are, nothing between them: a model has tens of thousands."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)
