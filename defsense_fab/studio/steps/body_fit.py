"""Cords, regions and poses that do not fit the newest body, and the edit that fits them to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import DefsenseError, LayoutError
from ...core.mesh import Surface
from ...workflow.design.body_fit import (
    BoxMap,
    Item,
    LimitViolation,
    Misfit,
    check_cords,
    find_misfits,
    fit_cords,
)
from ...workflow.view import Client, Request
from ..background.latest_worker import LatestWorker
from ..edits.body_fit import fit_to_body
from ..messages import body as messages
from ..session.computed_edit import REPAIR_S, EditBasis
from ..session.cord_states import rounded
from ..session.device_session import DeviceSession
from ..session.step import Handler, Step
from .poses.pose_records import uses_region

_SAME_BOX_MM = 0.01


class BodyFitStep(Step):
    """Judges cords, regions and poses by the newest body as soon as it is made.

    Each of them counts as made for the first body that it was in.

    Args:
        session: The device.
        on_misfit: Called with which regions and poses do not fit, in one sentence.
    """

    def __init__(self, session: DeviceSession, on_misfit: Callable[[str], None]) -> None:
        super().__init__(session)
        self._on_misfit = on_misfit
        self._worker = LatestWorker[Device](self._judge, session.show_error)
        self._published: messages.BodyFit | None = None
        self._misfits: list[Misfit] = []
        #: Bounds (2, 3) mm of the body that cords, regions and poses were made for, by content.
        self._boxes: dict[str, Float] = {}

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
        misfits, maps = list[Misfit](), dict[Item, BoxMap]()
        if surface is not None:
            try:
                check = check_cords(device, device.sensors, surface)
            except DefsenseError:  # shown once the device is built
                check = None
            misplaced = {(m.kind, m.name) for m in find_misfits(device, surface, check)}
            for item, content in _contents(device).items():
                if item not in misplaced:
                    self._boxes.setdefault(content, surface.bounds)
            maps = self._maps(device, surface)
            misfits = find_misfits(device, surface, check, maps)
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
        can_fit = any((m.kind, m.name) in maps for m in misfits)
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

    def _maps(self, device: Device, surface: Surface) -> dict[Item, BoxMap]:
        """Return maps to the newest body, for what was made for another one."""
        maps = dict[Item, BoxMap]()
        for item, content in _contents(device).items():
            box = self._boxes.get(content)
            if box is not None and np.abs(box - surface.bounds).max() > _SAME_BOX_MM:
                maps[item] = BoxMap(box, surface.bounds)
        return maps

    def _fit(self, client: Client, __: messages.FitToBody) -> None:
        session, basis = self.session, EditBasis.of(self.session)
        device, surface = basis.device, basis.surface
        maps = {} if surface is None else self._maps(device, surface)
        misfits = {(m.kind, m.name) for m in self._misfits}
        moved = misfits & maps.keys()
        if surface is None or not moved:
            raise LayoutError(
                "nothing was made for an earlier body",
                code="no-earlier-body",
                action="Repair the cords, or move regions by hand",
            )
        names = [s.name for s in device.sensors if ("cord", s.name) in misfits]
        check = basis.check_wanted(client)
        fitted = fit_cords(device, surface, names, maps, check, REPAIR_S)
        pairs = zip(device.sensors, fitted.sensors, strict=True)
        changed = [new for old, new in pairs if new is not old]
        edit = fit_to_body(device, changed, maps, moved)
        basis.apply(edit, "Fit again", changes_poses=True)
        session.notify(describe_result(edit.name, fitted.remaining, fitted.is_complete))


def describe_result(name: str, remaining: Sequence[LimitViolation], is_complete: bool) -> str:
    """Return what an edit has changed, and the limits that are still broken.

    Args:
        name: Name of the edit.
        remaining: The limits.
        is_complete: Whether all cords that break one were tried.
    """
    done = f"Done: {name.replace('`', '')}."
    if not remaining:
        return done
    listed = "; ".join(dict.fromkeys(str(violation) for violation in remaining))
    end = "" if is_complete else ". There was no time for the others: repair them in Sensors"
    return f"{done} Not within the limits: {listed}{end}"


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


def _contents(device: Device) -> dict[Item, str]:
    """Return a key of what lies in the body, for each cord, region and pose with points."""
    contents: dict[Item, str] = {
        ("cord", s.name): repr(("cord", s.plane, s.curve)) for s in device.sensors
    }
    contents |= {("region", name): repr((name, shape)) for name, shape in device.regions.items()}
    for pose in device.poses:
        pivots = [handle.about for handle in pose.handles]
        contents["pose", pose.name] = repr((pose.name, pivots, pose.drags))
    return contents
