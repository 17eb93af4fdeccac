"""What can be chosen in the step Measure: boards, recordings, models, sessions and specimens."""

from __future__ import annotations

from pathlib import Path

from ....core.device.device import Device
from ....core.errors import DefsenseError
from ....core.storage.files import unused_path
from ....workflow.run.choices import (
    KnownModel,
    changed_since,
    is_built,
    known_models,
    known_ports,
)
from ....workflow.run.outputs import LIVE_FILE
from ....workflow.sessions.known_sessions import KnownSession, known_sessions
from ....workflow.sessions.options import CALIBRATION_FILE
from ....workflow.sessions.recording import SESSION_FOLDER
from ....workflow.sessions.twin_sessions import session_folder
from ....workflow.tags.options import MARKERS_FOLDER
from ...messages.measure import MeasureChoices, ModelChoice, PortChoice, SessionChoice
from .results import test_error, usefulness_warning
from .specimens import SIMULATED_PREFIX, specimen_sessions

_REPLAY = "replay:"  # start of the ports of recordings


def find_choices(device: Device, models: list[KnownModel] | None = None) -> MeasureChoices:
    """Search a device's folder and this machine.

    Args:
        device: The device.
        models: The models of its folder, if they are known already.
    """
    folder = device.source
    sessions = known_sessions(device)
    specimens = [relative_name(p, folder) for p in specimen_sessions(folder)]
    return MeasureChoices(
        is_built=is_built(device),
        changes=_changes(device),
        ports=[
            PortChoice(port=p.port, label=p.label, is_board=not p.port.startswith(_REPLAY))
            for p in known_ports(device)
        ],
        models=[_model(model) for model in (known_models(device) if models is None else models)],
        sessions=[_session(session, folder) for session in sessions],
        free_seed=free_seed(device, 1),
        free_session=_free_session(sessions, folder),
        has_tags=(folder / MARKERS_FOLDER).exists(),
        has_calibration=(folder / CALIBRATION_FILE).exists(),
        has_live_file=(folder / LIVE_FILE).exists(),
        specimens=[n for n in specimens if not n.startswith(SIMULATED_PREFIX)],
        simulated_specimens=[n for n in specimens if n.startswith(SIMULATED_PREFIX)],
    )


def free_seed(device: Device, unit: int) -> int:
    """Return the smallest seed of the twin's unit without a session."""
    seed = 1
    while session_folder(device, unit, seed).exists():
        seed += 1
    return seed


def relative_name(path: str | Path, folder: Path) -> str:
    """Return a path relative to the device's folder if it is inside, else the whole path."""
    path = Path(path)
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)


def _free_session(sessions: list[KnownSession], folder: Path) -> str:
    """Return the session that can be resumed, or a name for a new one."""
    path = folder / SESSION_FOLDER
    is_finished = any(s.folder == path and not s.is_raw for s in sessions)
    return unused_path(path).name if is_finished else path.name


def _changes(device: Device) -> list[str]:
    if not is_built(device):
        return []
    try:
        return changed_since(device)
    except DefsenseError as error:
        return [str(error)]


def _model(model: KnownModel) -> ModelChoice:
    return ModelChoice(
        name=model.path.name,
        about=model.about,
        problem=model.problem or "",
        warning=usefulness_warning(model.metadata),
        error=test_error(model.metadata),
    )


def _session(session: KnownSession, folder: Path) -> SessionChoice:
    return SessionChoice(
        name=relative_name(session.folder, folder),
        summary=session.summary if session.frames else "",
        problem=session.problem,
        is_raw=session.is_raw,
    )
