"""Cords, regions and poses outside the newest body, and the edit that moves them with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import DefsenseError, LayoutError
from ...workflow.design.body_fit import BoxMap, Misfit, check_cords, find_misfits
from ...workflow.view import Client, Request
from ..background.latest_worker import LatestWorker
from ..edits.body_fit import fit_to_body
from ..messages import body as messages
from ..session.cord_states import rounded
from ..session.device_session import DeviceSession
from ..session.step import Handler, Step
from .poses.pose_records import uses_region

_SAME_BOX_MM = 0.01


class BodyFitStep(Step):
    """Judges cords, regions and poses by the newest body as soon as it is made.

    Args:
        session: The device.
        on_misfit: Called with which regions and poses lie outside the body, in one sentence.
    """

    def __init__(self, session: DeviceSession, on_misfit: Callable[[str], None]) -> None:
        super().__init__(session)
        self._on_misfit = on_misfit
        self._worker = LatestWorker[Device](self._judge, session.show_error)
        self._published: messages.BodyFit | None = None
        self._misfits: list[Misfit] = []
        #: Bounds (2, 3) mm of the body that cords, regions and poses were made for, by these.
        self._boxes: dict[str, Float] = {}
        self._last_box: Float | None = None

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        return {messages.FitToBody: self._fit}

    def on_device_changed(self) -> None:
        self._worker.give(self.session.device)

    def on_build_loaded(self) -> None:
        self._worker.give(self.session.device)

    def on_body_changed(self) -> None:
        self._worker.give(self.session.device)

    def wait(self, timeout_s: float) -> bool:
        """Wait until all is judged; return False after `timeout_s`."""
        return self._worker.wait(timeout_s)

    def close(self) -> None:
        self._worker.close()

    def _judge(self, device: Device) -> None:
        """Find what does not fit, on the thread of the worker."""
        surface = self.session.newest_surface
        misfits = list[Misfit]()
        if surface is not None:
            try:
                check = check_cords(device, device.sensors, surface)
            except DefsenseError:  # shown once the device is built
                check = None
            misfits = find_misfits(device, surface, check)
            if not misfits:
                self._last_box = self._boxes.setdefault(_places(device), surface.bounds)
        self._misfits = misfits
        used = [
            messages.MisfitState(
                kind="pose", name=pose.name, text=f"{pose.name} uses {m.name}: {m.text}", at=[]
            )
            for pose in device.poses
            for m in misfits
            if m.kind == "region" and uses_region(pose, m.name)
        ]
        states = [
            messages.MisfitState(kind=m.kind, name=m.name, text=m.text, at=rounded(np.array(m.at)))
            for m in misfits
        ]
        can_fit = bool(misfits) and self._box_map(device) is not None
        event = messages.BodyFit(
            text=describe_misfits(misfits, device.cord.noun) if can_fit else "",
            can_fit=can_fit,
            misfits=[*states, *used],
        )
        if event != self._published:
            self._published = event
            self.session.server.publish(event)
        others = [misfit for misfit in misfits if misfit.kind != "cord"]
        self._on_misfit(describe_misfits(others, device.cord.noun))

    def _box_map(self, device: Device) -> BoxMap | None:
        """Return the map from the earlier body to the newest one, if they differ."""
        surface, box = self.session.newest_surface, self._boxes.get(_places(device), self._last_box)
        if surface is None or box is None or np.abs(box - surface.bounds).max() < _SAME_BOX_MM:
            return None
        return BoxMap(box, surface.bounds)

    def _fit(self, _: Client, __: messages.FitToBody) -> None:
        session, device = self.session, self.session.device
        box_map, surface = self._box_map(device), session.newest_surface
        if box_map is None or surface is None:
            raise LayoutError(
                "the body that cords and regions were made for is not known",
                code="no-earlier-body",
                action="Move them by hand",
            )
        if _places(device) in self._boxes:
            kept = {("cord", sensor.name) for sensor in device.sensors}
            kept |= {("region", name) for name in device.regions}
            kept |= {("pose", pose.name) for pose in device.poses}
        else:  # some were moved since: only the others follow the body
            kept = {(misfit.kind, misfit.name) for misfit in self._misfits}
        bounds = surface.bounds
        session.apply(fit_to_body(device, box_map, kept))
        self._last_box = self._boxes[_places(session.device)] = bounds


def describe_misfits(misfits: Sequence[Misfit], noun: str) -> str:
    """Return how many cords, regions and poses do not fit, in one sentence; empty for none."""
    counts = [
        (sum(misfit.kind == kind for misfit in misfits), word)
        for kind, word in (("cord", noun), ("region", "region"), ("pose", "pull"))
    ]
    parts = [f"{n} {word}{'s' if n > 1 else ''}" for n, word in counts if n]
    if not parts:
        return ""
    listed = " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))
    is_one = len(misfits) == 1
    if all(misfit.is_outside for misfit in misfits):
        return f"{listed} {'is' if is_one else 'are'} outside the new body"
    return f"{listed} {'does' if is_one else 'do'} not fit the new body"


def _places(device: Device) -> str:
    """Return a key of all that lies in the body."""
    return repr((device.sensors, device.regions, device.poses))
