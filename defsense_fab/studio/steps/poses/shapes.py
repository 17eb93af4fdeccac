"""The shape of the pose that each browser shows, while the pose is changed and afterwards."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....core.arrays import Float
from ....core.device.device import Device, Pose
from ....core.errors import DefsenseError
from ....core.mesh import Surface
from ....workflow.design.pose_preview import PosePreview, PreviewedPose
from ....workflow.design.pose_ramp import Ramp, follow_ramp, load_ramp, unreached_message
from ....workflow.view import Arrays, Client, Problem
from ...messages.poses import PoseShape, PoseWarning, ShapePhase
from ...session.cord_states import rounded
from ...session.device_session import DeviceSession
from .pictures import drop_oldest
from .pose_queue import PoseQueue, SolverTask
from .pose_records import pose_digest
from .preview_work import PreviewAnswer, PreviewRequest

_MAX_RAMP_VALUES = 6_000_000  # of all frames, 24 MB
_MAX_FRAMES, _MIN_FRAMES = 25, 6
_LAST_SHAPE_STAYS = "The last shape stays."


@dataclass(frozen=True)
class ClientRequest(PreviewRequest):
    """A request of a browser.

    Attributes:
        client: The browser.
        digest: Digest of the pose.
    """

    client: Client | None = None
    digest: str = ""


@dataclass
class Shown:
    """What a browser shows.

    Attributes:
        pose: Name of the pose.
        digest: Digest of the pose that was solved last as the device has it.
        is_dragging: Whether the browser changes the pose.
        last_shape: Vertices (v, 3) mm of the last fine shape, or None.
    """

    pose: str
    digest: str = ""
    is_dragging: bool = False
    last_shape: Float | None = None


class ShapeWork:
    """Solves the poses that browsers show.

    Args:
        session: The device.
        on_solved: Called with the digest of a pose that was solved as a build does, and its
            displacements (v, 3) mm.
        on_warning: Called with the digest of such a pose, and what is wrong with it, or None.
        on_surface: Called with the body at rest after regions have changed, to which its mesh
            conforms.

    Attributes:
        queue: The solver.
    """

    def __init__(
        self,
        session: DeviceSession,
        on_solved: Callable[[str, Float], None],
        on_warning: Callable[[str, PoseWarning | None], None],
        on_surface: Callable[[Surface], None],
    ) -> None:
        self._session = session
        self._on_solved, self._on_warning = on_solved, on_warning
        self._on_surface = on_surface
        self._regions = ""  # those that the surface conforms to
        self._shown: dict[Client, Shown] = {}
        self._full: dict[str, Float] = {}  # displacements (v, 3) mm of solved poses, by digest
        self.queue = PoseQueue(self._show_answer, self._follow_solved, self._show_error)

    def use(self, preview: PosePreview | None) -> None:
        """Continue with the body of another build, or with none."""
        self._full.clear()
        self._regions = repr(self._session.device.regions)
        self.queue.work.use(preview)
        for client, shown in tuple(self._shown.items()):
            shown.last_shape, shown.digest = None, ""
            self._solve_again(client, shown)

    def show(self, client: Client, name: str, share: float = 1.0) -> None:
        """Solve a pose of the device for a browser."""
        pose = self._find(name)
        shown = self._shown.get(client)
        if pose is None:
            self.hide(client)
            return
        is_new = shown is None or shown.pose != name
        if shown is None or is_new:
            shown = self._shown[client] = Shown(name)
        shown.is_dragging = False
        is_final = share == 1.0
        if is_final:
            shown.digest = pose_digest(pose, self._session.device)
        self._give(client, pose, share=share, is_final=is_final, wants_coarse=is_new)

    def drag(self, client: Client, pose: Pose) -> None:
        """Solve a pose that a browser changes, and that is not written yet."""
        shown = self._shown.get(client)
        if shown is None or shown.pose != pose.name:
            shown = self._shown[client] = Shown(pose.name)
        shown.is_dragging = True
        self._give(client, pose, is_final=False)

    def end_drag(self, client: Client) -> None:
        """Solve the pose of a browser as the device has it, after a drag."""
        shown = self._shown.get(client)
        if shown is not None and shown.is_dragging:
            self._solve_again(client, shown)

    def hide(self, client: Client) -> None:
        """Stop to solve for a browser."""
        self._shown.pop(client, None)
        self.queue.drop(client)

    def follow_device(self) -> None:
        """Conform the body to changed regions, and solve the shown poses that have changed."""
        device, regions = self._session.device, repr(self._session.device.regions)
        if regions != self._regions:
            self._regions = regions
            self.queue.give(
                "regions", SolverTask(lambda preview, _: self._conform(preview, device))
            )
        for client, shown in tuple(self._shown.items()):
            pose = self._find(shown.pose)
            if pose is None:
                self.hide(client)
            elif pose_digest(pose, self._session.device) != shown.digest:
                self._solve_again(client, shown)

    def ramp(self, client: Client, pose: Pose, is_current: bool) -> Arrays:
        """Return the ramp of a pose as frames at equal shares, from the build or solved now.

        Args:
            client: The browser, which sees the shapes while they are solved.
            pose: The pose.
            is_current: Whether the build's states belong to the present poses.

        Raises:
            DefsenseError: The pose cannot be solved, or the solver was stopped.
        """
        device, folder = self._session.device, self._session.results.folder
        full = self._full.get(pose_digest(pose, device))

        def solve(preview: PosePreview, should_stop: Callable[[], bool]) -> Ramp | None:
            preview.take(device)
            if is_current or full is not None:
                ramp = load_ramp(folder, preview, pose, None if is_current else full)
                if ramp is not None:
                    return ramp
            rest = preview.surface.vertices

            def show_frame(share: float, moved: Float) -> None:
                self._send_vertices(client, pose.name, "solved", rest + moved, share)

            return follow_ramp(preview, pose, full, should_stop, show_frame)

        task = SolverTask(solve)
        self.queue.give(client, task)
        ramp = task.result()
        if ramp is None:
            raise DefsenseError("the solver was stopped", code="canceled")
        return _ramp_arrays(ramp)

    def wait(self, timeout_s: float) -> bool:
        """Wait until all shapes are sent; return False after `timeout_s`."""
        return self.queue.wait(timeout_s)

    def close(self) -> None:
        """End the thread."""
        self.queue.close()

    def _find(self, name: str) -> Pose | None:
        return next((p for p in self._session.device.poses if p.name == name), None)

    def _solve_again(self, client: Client, shown: Shown) -> None:
        pose = self._find(shown.pose)
        if pose is None:
            return
        # After a drag a coarse shape would be a step back from the fine one that is shown.
        wants_coarse = not shown.is_dragging
        shown.is_dragging = False
        shown.digest = pose_digest(pose, self._session.device)
        self._give(client, pose, wants_coarse=wants_coarse)

    def _give(
        self,
        client: Client,
        pose: Pose,
        *,
        share: float = 1.0,
        is_final: bool = True,
        wants_coarse: bool = True,
    ) -> None:
        device: Device = self._session.device
        request = ClientRequest(
            device,
            pose,
            share,
            is_final,
            wants_coarse,
            time.perf_counter(),
            client,
            pose_digest(pose, device),
        )
        if is_final:
            self._send(client, pose.name, "solving", None)
        self.queue.give(client, request)
        if not client.is_open:  # it was closed meanwhile, and nobody else forgets it
            self.hide(client)

    # On the thread of the solver

    def _conform(self, preview: PosePreview, device: Device) -> None:
        preview.take(device)
        self._on_surface(preview.surface)

    def _show_answer(self, request: PreviewRequest, answer: PreviewAnswer) -> None:
        assert isinstance(request, ClientRequest)
        assert request.client is not None
        shown = self._shown.get(request.client)
        if shown is None or shown.pose != request.pose.name:
            return
        vertices, fine = answer.vertices, answer.fine
        if fine is not None and vertices is not None:
            shown.last_shape = vertices
        elif vertices is None:  # a coarse shape may have been shown meanwhile
            vertices = shown.last_shape
        phase, text = describe(request, fine)
        text = f"{text} {_LAST_SHAPE_STAYS}" if phase == "not-reached" else text
        centers = {} if fine is None or fine.moved is None else dict(fine.centers)
        self._send(
            request.client,
            request.pose.name,
            phase,
            vertices,
            share=request.share,
            text=text,
            centers=centers,
        )

    def _follow_solved(
        self, _: PosePreview, request: PreviewRequest, solved: PreviewedPose
    ) -> None:
        assert isinstance(request, ClientRequest)
        if not request.is_final or solved.is_cancelled:
            return
        phase, text = describe(request, solved)
        warning = None
        if text:
            warning = PoseWarning(code=f"pose-{phase}", text=text, share=solved.share)
        if solved.moved is not None:
            self._full[request.digest] = solved.moved
            drop_oldest(self._full, {pose_digest(p, request.device) for p in request.device.poses})
            self._on_solved(request.digest, solved.moved)
        self._on_warning(request.digest, warning)

    def _show_error(self, request: PreviewRequest | None, error: Exception) -> None:
        if not isinstance(request, ClientRequest) or request.client is None:
            self._session.show_error(error)
            return
        problem = Problem.of(error)
        shown = self._shown.get(request.client)
        if shown is not None and shown.pose == request.pose.name:
            text = f"{problem.message} {_LAST_SHAPE_STAYS}"
            self._send(request.client, request.pose.name, "failed", shown.last_shape, text=text)
        if request.is_final:
            warning = PoseWarning(code=problem.code, text=problem.message, share=0.0)
            self._on_warning(request.digest, warning)

    def _send_vertices(
        self, client: Client, pose: str, phase: ShapePhase, vertices: Float, share: float
    ) -> None:
        arrays = {"vertices": vertices.astype(np.float32)}
        facts = {"pose": pose, "phase": phase, "share": share}
        client.send_arrays(Arrays(name="pose-shape", arrays=arrays, facts=facts))

    def _send(
        self,
        client: Client,
        pose: str,
        phase: ShapePhase,
        vertices: Float | None,
        *,
        share: float = 1.0,
        text: str = "",
        centers: dict[str, Float] | None = None,
    ) -> None:
        if vertices is not None:
            self._send_vertices(client, pose, phase, vertices, share)
        listed = {name: rounded(center) for name, center in (centers or {}).items()}
        client.send(PoseShape(pose=pose, phase=phase, share=share, text=text, centers=listed))


def describe(request: PreviewRequest, fine: PreviewedPose | None) -> tuple[ShapePhase, str]:
    """Return the phase of a shape, and what is wrong with it."""
    if fine is None:
        return "coarse", ""
    if fine.is_cancelled:
        return "canceled", ""
    if fine.moved is None:
        return "not-reached", unreached_message(request.pose.name, fine.share).replace("`", "")
    if fine.problem:
        problem = f"{fine.problem[:1].upper()}{fine.problem[1:]}"
        return "invalid", f"{problem}. Reduce its movement, or enlarge its regions."
    return ("checked" if request.is_final else "solved"), ""


def _ramp_arrays(ramp: Ramp) -> Arrays:
    end, size = float(ramp.shares[-1]), ramp.moved[0].size
    count = int(np.clip(_MAX_RAMP_VALUES // max(size, 1), _MIN_FRAMES, _MAX_FRAMES))
    frames = np.stack([ramp.at(share) for share in np.linspace(0.0, end, count)])
    return Arrays(
        name="pose-ramp",
        arrays={"frames": frames.astype(np.float32)},
        facts={
            "end": end,
            "shares": ramp.shares.tolist(),
            "isSimulated": ramp.is_simulated,
            "remark": ramp.remark,
            "code": ramp.code,
        },
    )
