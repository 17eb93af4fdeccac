"""Read and write `model.json`: a trained model as plain numbers for any program (docs/model.md).

A hash of the content detects files that are truncated or edited. A model that moves a character or
plays an instrument must not do so with half a matrix.
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
from ...store.layout import LayoutRecord, layout_hash

MODEL = "model.json"

_OPTIONAL = ("targets", "readings")  # fields that models of devices do not have
_TAIL_BYTES = 100  # at a model's end, which contain its hash
_ACTION = "Write such a file with defsense train"


def write_model(path: Path, model: TrainedModel) -> None:
    """Write a model to a file.

    Args:
        path: The file.
        model: The model.

    Raises:
        StorageError: If the file cannot be written.
    """
    data = {"schema": model.SCHEMA, **typed_json.to_json(model)}
    for name in _OPTIONAL:
        if data.get(name) is None:
            data.pop(name, None)
    write_text(path, _serialize({**data, "sha256": _hash(data)}) + "\n")


def is_model(path: Path) -> bool:
    """Return whether a file seems to be a complete model, by its end only, to be fast."""
    try:
        with path.open("rb") as file:
            file.seek(-min(_TAIL_BYTES, path.stat().st_size), 2)
            return b'"sha256":' in file.read()
    except OSError:
        return False


def load_model(path: Path) -> TrainedModel:
    """Load a model.

    Args:
        path: The file, or the folder that contains `model.json`.

    Returns:
        The model.

    Raises:
        TrainingError: If the file is not a complete model as it was written.
    """
    path = path / MODEL if path.is_dir() else path
    try:
        data = load_json(path, TrainingError, _ACTION)
    except RecursionError:
        data = None
    if not isinstance(data, dict) or "sha256" not in data:
        raise TrainingError(
            "is not a trained model", code="not-a-model", where=path, action=_ACTION
        )
    if (schema := data.pop("schema", None)) != TrainedModel.SCHEMA:
        raise TrainingError(
            f"has schema {schema}, but this version reads schema {TrainedModel.SCHEMA}",
            code="wrong-schema",
            where=path,
            action="Train the model again",
        )
    stated_hash = data.pop("sha256")
    try:
        is_unchanged = _hash({"schema": TrainedModel.SCHEMA, **data}) == stated_hash
    except ValueError:  # NaN or infinity
        is_unchanged = False
    if not is_unchanged:
        raise TrainingError(
            "was changed after it was written: its hash does not match",
            code="content-changed",
            where=path,
            action="Take an unchanged copy, or train the model again",
        )
    try:
        return typed_json.from_json(data, TrainedModel)
    except msgspec.ValidationError as error:
        raise TrainingError(
            f"is damaged ({error})",
            code="file-damaged",
            where=path,
            action="Train the model again",
        ) from None


def is_of_other_cords(model: TrainedModel, layout: LayoutRecord) -> bool:
    """Return whether a model was trained on other cords than a layout's; False if unknown."""
    return bool(model.layout) and model.layout != layout_hash(layout)


def _hash(data: dict[str, Any]) -> str:
    return hashlib.sha256(_serialize(data).encode()).hexdigest()


def _serialize(data: dict[str, Any]) -> str:
    """Return compact JSON with all digits: a model has tens of thousands of numbers."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)
