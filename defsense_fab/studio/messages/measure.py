"""Messages of the step Measure: check the board, record, train, calibrate the cord, run live."""

from __future__ import annotations

from typing import Literal

from ...workflow.view import Event, Problem, Record, Request

TaskState = Literal["idle", "running", "stopping"]


class PortChoice(Record, frozen=True, kw_only=True):
    """A source of readings.

    Attributes:
        port: The port, as the command line takes it.
        label: Its name for users.
        is_board: Whether it is a board, real or simulated, and not a recording.
    """

    port: str
    label: str
    is_board: bool


class ModelChoice(Record, frozen=True, kw_only=True):
    """A model in the device's folder.

    Attributes:
        name: Name of its file.
        about: One line on it.
        problem: Why it cannot be used; empty if it can.
        warning: Why its test found it useless; empty for a useful one.
        error: Its test error, mm (RMSE); None if it was not tested.
    """

    name: str
    about: str
    problem: str
    warning: str
    error: float | None


class SessionChoice(Record, frozen=True, kw_only=True):
    """A recorded session.

    Attributes:
        name: Its folder, relative to the device's folder.
        summary: Description in one line; empty if it is not processed.
        problem: Why it cannot be used for training; empty if it can.
        is_raw: Whether it was recorded, but not processed yet.
    """

    name: str
    summary: str
    problem: str
    is_raw: bool


class MeasureChoices(Event, frozen=True, kw_only=True):
    """What can be chosen: boards, recordings, models and sessions.

    Attributes:
        is_built: Whether the device has been built.
        changes: Sentences on the cords that differ from the build.
        ports: Sources of readings, the simulated twin first.
        models: Models, the newest first.
        sessions: Sessions, the newest last.
        free_seed: The next seed of the twin's unit 1 without a session.
        free_session: A name for a new session.
        has_tags: Whether the device's tags exist, which recordings need.
        has_calibration: Whether there is a calibration of cameras.
        has_live_file: Whether the folder has a file with outputs.
        specimens: Measured sessions on specimens of the cord.
        simulated_specimens: Simulated sessions.
    """

    is_built: bool
    changes: list[str]
    ports: list[PortChoice]
    models: list[ModelChoice]
    sessions: list[SessionChoice]
    free_seed: int
    free_session: str
    has_tags: bool
    has_calibration: bool
    has_live_file: bool
    specimens: list[str]
    simulated_specimens: list[str]


class TaskStatus(Record, frozen=True, kw_only=True):
    """What a task does, or how its last run ended.

    Attributes:
        state: Whether it runs.
        code: Stable identifier of what came of it, such as "recording-complete"; else empty.
        text: What it does, or what came of it.
        problem: Why it failed, or None.
    """

    state: TaskState = "idle"
    code: str = ""
    text: str = ""
    problem: Problem | None = None


class MeasureStatus(Event, frozen=True, kw_only=True):
    """What the tasks of the step do."""

    check: TaskStatus
    record: TaskStatus
    train: TaskStatus
    specimen: TaskStatus
    live: TaskStatus


class ChannelFinding(Record, frozen=True, kw_only=True):
    """What a check found on one channel.

    Attributes:
        channel: Index of the channel.
        cord: Name of the cord.
        code: "ok", or a stable code of the fault.
        text: What was found.
        action: What to do; empty if nothing.
    """

    channel: int
    cord: str
    code: str
    text: str
    action: str


class CheckResult(Record, frozen=True, kw_only=True):
    """The result of the last check of the board.

    Attributes:
        port: The board's port.
        is_sound: Whether all channels are in order.
        is_complete: Whether all steps were done.
        findings: One finding for each channel.
        notes: What could not be decided.
        rate: Readings per second.
        averages: Conversions per reading.
        reference: Reference resistors that were assumed (c,), ohm.
    """

    port: str
    is_sound: bool
    is_complete: bool
    findings: list[ChannelFinding]
    notes: list[str]
    rate: float
    averages: int
    reference: list[float]


class DecoderResult(Record, frozen=True, kw_only=True):
    """Errors of one decoder of a training, mm.

    Attributes:
        decoder: Its name.
        folds: RMSE by cross-validation.
        test: RMSE of the test; None if it was not tested.
        peak: Largest error of the test.
        is_chosen: Whether the model uses it.
    """

    decoder: str
    folds: float
    test: float | None
    peak: float | None
    is_chosen: bool


class TrainingResult(Record, frozen=True, kw_only=True):
    """A trained model.

    Attributes:
        model: Name of its file.
        decoders: The decoders that were compared.
        trained_images: Number of images of the training; None if unknown.
        tested_images: Number of images of the test; None if unknown.
        trained_on: What it was trained on, if that was no measurement; else empty.
        warning: Why its test found it useless; empty for a useful model.
        notes: Notes on the training.
    """

    model: str
    decoders: list[DecoderResult]
    trained_images: int | None
    tested_images: int | None
    trained_on: str
    warning: str
    notes: list[str]


class EvaluationResult(Record, frozen=True, kw_only=True):
    """Errors of a model on images that were not used for training, mm.

    Attributes:
        model: Name of the model's file.
        rmse: Root mean square error.
        deviation: Standard deviation of the frames' errors.
        peak: Largest error.
        average_peak: Mean over the frames of the largest error.
        frames: Number of frames.
        notes: Notes on the evaluation.
    """

    model: str
    rmse: float
    deviation: float
    peak: float
    average_peak: float
    frames: int
    notes: list[str]


class ResponseResult(Record, frozen=True, kw_only=True):
    """A fitted response of the cord.

    Attributes:
        k_res: Relative change of resistance per strain.
        interval: Its 95 % interval, from and to.
        reason: Why this response was chosen.
        strains: Smallest and largest strain.
        readings: Number of readings.
        pieces: Number of pieces of cord.
        warnings: Warnings.
        is_simulated: Whether it was fitted to simulated specimens.
        can_use: Whether the device does not use it yet.
    """

    k_res: float
    interval: list[float]
    reason: str
    strains: list[float]
    readings: int
    pieces: int
    warnings: list[str]
    is_simulated: bool
    can_use: bool


class MeasureResults(Event, frozen=True, kw_only=True):
    """The last results; each is None before the first one."""

    check: CheckResult | None = None
    training: TrainingResult | None = None
    evaluation: EvaluationResult | None = None
    response: ResponseResult | None = None


class RefreshChoices(Request, frozen=True, kw_only=True):
    """Search for boards, recordings, models and sessions again."""


class StartCheck(Request, frozen=True, kw_only=True):
    """Check the wiring of the device on its board, step by step.

    Attributes:
        port: The board's port, or the simulated twin.
        wiggle: Whether the wire of each cord is moved, which finds loose contacts.
        poses: Whether poses are held, if only they show which cord is on which pin.
        reference: Reference resistors, ohm; empty for those that the build proposes.
    """

    port: str
    wiggle: bool
    poses: bool
    reference: list[float]


class MakeTags(Request, frozen=True, kw_only=True):
    """Choose places for the device's tags, and draw sheets to print."""


class StartRecording(Request, frozen=True, kw_only=True):
    """Record the device, step by step, or resume a stopped session.

    Attributes:
        port: The board's port, "twin" or "none".
        cameras: A camera for each one of the calibration; "twin" or "none".
        calibration: The cameras' calibration file in the device's folder.
        session: Name of the session's folder.
        rounds: Number of rounds through all poses.
        seconds: Time for each pose, s.
    """

    port: str
    cameras: str
    calibration: str
    session: str
    rounds: int
    seconds: float


class RecordTwin(Request, frozen=True, kw_only=True):
    """Record a session of the device's simulated twin.

    Attributes:
        minutes: Duration of the session.
        unit: The built unit, with its tolerances and pieces of cord.
        seed: Seed of the hand's path.
        cords: Family of the cords' memory; empty for the default.
    """

    minutes: float
    unit: int
    seed: int
    cords: str


class ProcessSessions(Request, frozen=True, kw_only=True):
    """Process the recorded sessions that are not processed yet."""


class TrainModel(Request, frozen=True, kw_only=True):
    """Train a model on sessions."""

    sessions: list[str]


class TrainOnSimulation(Request, frozen=True, kw_only=True):
    """Train a model on the simulated states alone, without any session."""


class EvaluateModel(Request, frozen=True, kw_only=True):
    """Evaluate the trained model on sessions."""

    sessions: list[str]


class MeasureSpecimen(Request, frozen=True, kw_only=True):
    """Measure a specimen of the cord jig by jig, or continue its measurement.

    Attributes:
        port: The board's port, or "twin:speed=20".
        specimen: Folder of the specimen in the device's folder.
    """

    port: str
    specimen: str


class SimulateSpecimens(Request, frozen=True, kw_only=True):
    """Simulate two specimens of the cord."""


class FitResponse(Request, frozen=True, kw_only=True):
    """Fit the cord's response to the specimens; to simulated ones only without measured ones."""


class UseResponse(Request, frozen=True, kw_only=True):
    """Use the fitted response in the device."""


class StopGuided(Request, frozen=True, kw_only=True):
    """Stop the guided run, which can be continued later."""


class StartLive(Request, frozen=True, kw_only=True):
    """Run the device live.

    Attributes:
        model: Name of the model's file.
        port: Source of the readings.
        outputs: Outputs, such as "osc,port=9000"; separated by semicolons.
        uses_file: Whether the outputs of live.toml are used, too.
        keeps_readings: Whether the readings are saved.
    """

    model: str
    port: str
    outputs: str
    uses_file: bool
    keeps_readings: bool


class StopLive(Request, frozen=True, kw_only=True):
    """End the live run."""
