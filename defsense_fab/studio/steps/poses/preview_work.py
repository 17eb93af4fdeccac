"""Solve poses on a thread while the user changes them; the latest request counts."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from ....core.arrays import Float
from ....core.device.device import Device, Pose
from ....core.errors import DefsenseError
from ....core.mesh import TetMesh
from ....workflow.design.pose_preview import PosePreview, PreviewedPose, load_coarse_mesh
from ...background.latest_worker import LatestWorker

_MAX_RESPONSE_TIMES = 500


@dataclass(frozen=True)
class PreviewRequest:
    """A request to solve a pose.

    Attributes:
        device: The device.
        pose: The pose, which may differ from that of the device.
        share: Share of the pose's ramp.
        is_final: Whether the user has finished the change; then the pose is solved from rest, as
            accurately as a build does, and checked.
        wants_coarse: Whether a coarse shape is shown before the fine one.
        requested_at: Time of the user's action, s of `time.perf_counter`.
    """

    device: Device
    pose: Pose
    share: float = 1.0
    is_final: bool = False
    wants_coarse: bool = True
    requested_at: float = 0.0


@dataclass(frozen=True)
class PreviewAnswer:
    """A shape of a requested pose.

    Attributes:
        vertices: Vertices (v, 3) mm of the surface; None if the pose was not reached.
        fine: Result on the fine mesh; None for the coarse shape.
    """

    vertices: Float | None
    fine: PreviewedPose | None


@dataclass(frozen=True)
class ResponseTimes:
    """Times from the user's action to the answers.

    Attributes:
        coarse_s: Time to the coarse shape, s; None if there was none.
        fine_s: Time to the fine shape, s; None if the pose was not reached.
    """

    coarse_s: float | None
    fine_s: float | None


class PreviewWork:
    """Solve the latest requested pose. The callbacks are called on a thread of this object.

    Args:
        on_answer: Called with each shape.
        on_solved: Called with the fine result of the latest request, and the preview that solved
            it.
        on_error: Called with an error, such as that of a pose that the body cannot have.
        on_done: Called after each request or action; after one that failed, before `on_error`.

    Attributes:
        response_times: Times of the last answers.
    """

    def __init__(
        self,
        on_answer: Callable[[PreviewRequest, PreviewAnswer], None],
        on_solved: Callable[[PosePreview, PreviewRequest, PreviewedPose], None],
        on_error: Callable[[Exception], None],
        on_done: Callable[[], None] = lambda: None,
    ) -> None:
        self._on_answer, self._on_solved = on_answer, on_solved
        self._on_done = on_done
        self._latest: object = None
        self._cancelled_at = 0.0
        self._lock = threading.Lock()
        self._preview: PosePreview | None = None
        self._preparing: PosePreview | None = None  # its coarse mesh is being made
        self._next_preview: list[PosePreview | None] = []  # at most one, of another build
        self._coarse_meshes: list[tuple[PosePreview, TetMesh]] = []  # not used yet
        self.response_times: deque[ResponseTimes] = deque(maxlen=_MAX_RESPONSE_TIMES)
        self._worker: LatestWorker[PreviewRequest | Callable[[PosePreview], None]] = LatestWorker(
            self._handle, on_error
        )

    @property
    def has_coarse(self) -> bool:
        """Whether the next request is answered by a coarse shape first."""
        with self._lock:
            preview = self._next_preview[0] if self._next_preview else self._preview
            is_meshed = any(owner is preview for owner, _ in self._coarse_meshes)
            return preview is not None and (is_meshed or preview.has_coarse)

    @property
    def is_preparing(self) -> bool:
        """Whether the coarse mesh is being made."""
        return self._preparing is not None

    def use(self, preview: PosePreview | None) -> None:
        """Continue with the preview of another build, or with none; make its coarse mesh."""
        with self._lock:
            self._next_preview = [preview]
            self._preparing = preview
        if preview is not None:
            threading.Thread(target=self._make_coarse_mesh, args=(preview,), daemon=True).start()

    def give(self, request: PreviewRequest) -> None:
        """Request a pose and return at once; call it from any thread."""
        self._latest = request
        self._worker.give(request)

    def call(self, action: Callable[[PosePreview], None]) -> None:
        """Call a longer action with the preview, on the thread that solves poses."""
        self._latest = action
        self._worker.give(action)

    def is_latest(self, item: object) -> bool:
        """Return whether a request or action is the latest one."""
        return self._latest is item

    def supersede(self) -> None:
        """Let the running request end early, as a newer one will be given after it."""
        self._latest = None

    def cancel(self) -> None:
        """Cancel the running request."""
        self._cancelled_at = time.perf_counter()

    def is_cancelled_since(self, started_at: float) -> bool:
        """Return whether `cancel` was called after a time, s of `time.perf_counter`."""
        return self._cancelled_at > started_at

    def wait(self, timeout_s: float) -> bool:
        """Wait until all requests are handled; return False after `timeout_s`."""
        return self._worker.wait(timeout_s)

    def close(self) -> None:
        """End the thread."""
        self.cancel()
        self._worker.close()

    def _make_coarse_mesh(self, preview: PosePreview) -> None:
        try:
            mesh = load_coarse_mesh(preview.device)
        except (DefsenseError, OSError):  # there are only fine shapes, which take longer
            mesh = None
        with self._lock:
            if mesh is not None:
                self._coarse_meshes = [(preview, mesh)]
            if self._preparing is preview:
                self._preparing = None

    def _handle(self, item: PreviewRequest | Callable[[PosePreview], None]) -> None:
        try:
            preview = self._current_preview()
            if preview is not None and isinstance(item, PreviewRequest):
                self._solve(preview, item)
            elif preview is not None and not isinstance(item, PreviewRequest):
                item(preview)
        finally:
            self._on_done()

    def _solve(self, preview: PosePreview, request: PreviewRequest) -> None:
        started_at = time.perf_counter()
        preview.take(request.device)
        rest, coarse_times = preview.surface.vertices, list[float]()

        def show_coarse(displacements: Float) -> None:
            self._on_answer(request, PreviewAnswer(rest + displacements, None))
            coarse_times.append(time.perf_counter() - request.requested_at)

        fine = preview.edit(
            request.pose,
            request.share,
            show_coarse if request.wants_coarse else None,
            lambda: self.is_cancelled_since(started_at),
            lambda: not self.is_latest(request),
            check=request.is_final,
            from_rest=request.is_final,
        )
        vertices = None if fine.moved is None else rest + fine.moved
        if not fine.is_cancelled or self.is_latest(request):
            self._on_answer(request, PreviewAnswer(vertices, fine))
        fine_s = None if vertices is None else time.perf_counter() - request.requested_at
        self.response_times.append(ResponseTimes(coarse_times[0] if coarse_times else None, fine_s))
        if self.is_latest(request):
            self._on_solved(preview, request, fine)

    def _current_preview(self) -> PosePreview | None:
        with self._lock:
            if self._next_preview:
                if self._preview is not None:
                    self._preview.close()
                self._preview = self._next_preview.pop()
            for preview, mesh in self._coarse_meshes:
                if preview is self._preview:
                    preview.take_coarse(mesh)
            if self._preview is not None:
                self._coarse_meshes = [m for m in self._coarse_meshes if m[0] is not self._preview]
        return self._preview
