"""The step Optimize: watch the search, compare layouts, and use one."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from ....core.device.device import Sensor
from ....core.errors import DefsenseError, LayoutError, StorageError
from ....workflow.build.results import layout_digest, simulation_digest
from ....workflow.design.compare_layouts import (
    ComparedLayout,
    estimate_seconds,
    tried_layouts,
)
from ....workflow.study.cord_count import studied_layouts
from ....workflow.view import Arrays, Client, Request
from ...background.latest_worker import LatestWorker
from ...edits.cords import take_cords, unlock_cords
from ...messages import optimize as messages
from ...session.built_cords import built_cords, can_move_cords
from ...session.cord_check import CordCheck
from ...session.device_session import DeviceSession
from ...session.job_strip import Work
from ...session.step import Handler, Step
from .comparison_job import round_time, run_comparison
from .error_map import ErrorMap
from .ghost_cords import are_same
from .layout_rows import (
    RowContext,
    best_layout,
    earlier_layouts,
    is_complete,
    layout_rows,
    with_drawn,
    without_outdated,
)
from .search_watch import SearchWatch
from .standing import Facts, optimize_state

_STAGE_INPUTS = {"body": "the body", "mesh": "the mesh", "simulate": "the poses"}


def _ignore(_: bool) -> None:
    pass


class OptimizeStep(Step):
    """Publishes the search, the layouts and what is true of them.

    Args:
        session: The device.
        check: Makes the drawn cords on trial.
        on_optimized: Called with whether the drawn cords are those that the last search found.

    Attributes:
        watch: The search of the current or last build.
        layouts: The layouts of the last build and those that were compared with them.
        state: What was published last of the drawn and of the optimized cords, or None.
        rows: What was published last of the layouts, or None.
    """

    def __init__(
        self,
        session: DeviceSession,
        check: CordCheck,
        on_optimized: Callable[[bool], None] = _ignore,
    ) -> None:
        super().__init__(session)
        self._check = check
        check.on_result.append(lambda: self._worker.give(None))
        self._on_optimized = on_optimized
        self.watch = SearchWatch(session, self._publish_state)
        self.layouts: list[ComparedLayout] = []
        self._earlier: list[ComparedLayout] = []
        self.state: messages.OptimizeState | None = None
        self.rows: messages.Layouts | None = None
        self._map = ErrorMap()
        self._lock = threading.RLock()
        self._digest: str | None = None  # of the layout that is compared
        self._poses = ""  # digest of those that it was found for
        self._drawn_row: messages.LayoutRow | None = None
        self._best = "", ""  # layout to use, and why there is none
        self._worker = LatestWorker[None](self._publish_layouts, session.show_error)
        self._reader = LatestWorker[None](self._read_build, session.show_error)

    @property
    def handlers(self) -> Mapping[type[Request], Handler]:
        return {
            messages.ErrorMapOf: self._error_map,
            messages.UseLayout: self._use_layout,
            messages.UseBest: self._use_best,
            messages.UnlockCords: lambda _, __: self.session.apply(unlock_cords()),
            messages.CompareLayouts: self._compare,
        }

    def on_device_changed(self) -> None:
        self._worker.give(None)

    def on_build_loaded(self) -> None:
        if not self.session.jobs.is_running:
            self.watch.end()
        self._reader.give(None)

    def on_freshness(self) -> None:
        self._worker.give(None)

    def wait(self, timeout_s: float) -> bool:
        """Wait until all is published; return False after a time."""
        workers = (self._reader, self.watch.worker, self._worker)
        return all(worker.wait(timeout_s) for worker in workers)

    def close(self) -> None:
        self.watch.close()
        self._reader.close()
        self._worker.close()

    # Requests

    def _error_map(self, _: Client, request: messages.ErrorMapOf) -> Arrays:
        return self._map.arrays(request.state)

    def _use_layout(self, _: Client, request: messages.UseLayout) -> None:
        with self._lock:
            known = [*self.layouts, *self._earlier]
            layout = next((x for x in known if x.name == request.name), None)
        if layout is None or not layout.sensors:
            raise LayoutError(
                f"there is no layout {request.name!r} any more",
                code="no-layout",
                action="Choose another layout",
            )
        if layout.problem is not None:
            raise _not_makeable(f"the layout {request.name!r} cannot be made", layout.problem)
        self._use(layout.sensors, f"use the layout `{request.name}`")

    def _use_best(self, _: Client, __: messages.UseBest) -> None:
        if self.watch.record.best is None:
            raise LayoutError(
                "no cords within all limits are found yet",
                code="no-cords-found",
                action="Wait until some are found",
            )
        trials = self.watch.make_best()
        best = trials[-1]
        if best.problem is not None:
            raise _not_makeable("the best cords so far cannot be made", best.problem.text)
        if self.watch.search.state == "running":
            self.session.jobs.cancel()
        self._use(best.sensors, "use the best cords of the search")
        if len(trials) > 1:
            self.session.notify(
                f"The best cords so far cannot be made: these have {best.drawn_error:.2f} mm in"
                f" place of {trials[0].drawn_error:.2f} mm without the cuts"
            )

    def _use(self, sensors: Sequence[Sensor], name: str) -> None:
        self.session.taken_layouts.append(tuple(sensors))
        self.session.edit_and_lock(replace(take_cords(sensors), name=name))

    def _compare(self, _: Client, __: messages.CompareLayouts) -> None:
        obstacle = self._obstacle()
        if obstacle:
            raise StorageError(obstacle, code="build-outdated", action="Optimize the cords again")
        self.session.jobs.start(
            Work(
                name="comparison",
                title="Compare the layouts",
                job=run_comparison,
                arguments=(self.session.project.folder,),
                on_item=self._add,
                on_end=self._end_comparison,
                can_pause=True,
            )
        )

    def _add(self, layout: ComparedLayout) -> None:
        with self._lock:
            others = [other for other in self.layouts if other.name != layout.name]
            self.layouts = [*others, layout]
        self._worker.give(None)

    def _end_comparison(self, _: DefsenseError | None, __: object) -> None:
        self._worker.give(None)

    # Published states, on the threads of the workers

    def _read_build(self, _: None) -> None:
        session = self.session
        device, build = session.device, session.results
        poses, current, layouts = "", None, list[ComparedLayout]()
        with suppress(DefsenseError, OSError):
            poses = simulation_digest(build)
            tried = [*tried_layouts(build), *studied_layouts(device, build.folder)]
            current, layouts = layout_digest(build), tried
        with self._lock:
            if current is None or current != self._digest:
                # Errors of other poses, or in another body, are not comparable.
                is_comparable = poses == self._poses
                self._earlier = [*self._earlier, *self.layouts] if is_comparable else []
                self._digest, self._poses, self.layouts = current, poses, layouts
            # else another stage was built: the comparison is still valid
        if build is not self._map.build:
            session.server.publish(self._map.load(build))
        self._worker.give(None)

    def _publish_layouts(self, _: None) -> None:
        session = self.session
        trial = self._check.result(session.device.sensors)
        context = RowContext(session.device, session.judge, trial)
        with self._lock:
            self.layouts = without_outdated(self.layouts, session.device.sensors)
            layouts = list(self.layouts)
            self._earlier = earlier_layouts(self._earlier, layouts, ())
            earlier = earlier_layouts(self._earlier, (), session.device.sensors)
        layouts = with_drawn(context, layouts)
        self._best = best_layout(layouts)
        rows = [*layout_rows(context, layouts), *layout_rows(context, earlier)]
        self._drawn_row = next((row for row in rows if row.is_drawn), None)
        self.rows = messages.Layouts(
            rows=rows, compare_seconds=self._compare_seconds(layouts), obstacle=self._obstacle()
        )
        session.server.publish(self.rows)
        self._publish_state()

    def _publish_state(self) -> None:
        session, search = self.session, self.watch.search
        device, built = session.device, built_cords(session.results)
        is_drawn = built is not None and are_same(built.sensors, device.sensors)
        is_searching, row = search.state == "running", self._drawn_row
        drawn = row.error if row is not None else None
        is_in_parts = not is_searching and row is not None and row.parts is not None
        built_error = None if built is None else built.error
        if is_drawn and is_in_parts:  # settings that change it may have changed since
            built_error = drawn
        self.state = optimize_state(
            Facts(
                noun=device.cord.noun,
                has_poses=bool(device.poses),
                has_cords=bool(device.sensors) or bool(device.propose),
                can_move=can_move_cords(device),
                is_simulated=session.freshness.get("simulate") == "current",
                is_searching=is_searching,
                best=search.best,
                drawn=search.drawn if is_searching else drawn,
                is_drawn_in_parts=is_in_parts,
                built=built_error,
                is_built_drawn=is_drawn,
                is_built_moved=built is not None and built.is_moved,
                is_current=session.freshness.get("optimize") == "current",
                best_layout=self._best[0],
                best_problem=self._best[1],
            )
        )
        session.server.publish(self.state)
        self._on_optimized(self.state.standing == "optimized")

    def _obstacle(self) -> str:
        """Return why layouts cannot be compared; empty if they can."""
        if not self.layouts:
            return "the cords have not been optimized yet"
        for stage, text in _STAGE_INPUTS.items():
            if self.session.freshness.get(stage) != "current":
                return f"{text} changed after the last optimization"
        return ""

    def _compare_seconds(self, layouts: Sequence[ComparedLayout]) -> int:
        if not layouts or is_complete(layouts):
            return 0
        try:
            return round_time(estimate_seconds(self.session.device, self.session.results))
        except (DefsenseError, OSError):  # a build replaces it
            return 0


def _not_makeable(what: str, reason: str) -> LayoutError:
    return LayoutError(f"{what}: {reason.rstrip('.')}", code="layout-not-makeable")
