"""The controls of the section."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...core.curve import Plane
from ...core.device.device import Sensor
from ..workbench.controls import on_user
from ..workbench.page_texts import StatusText
from ..workbench.workbench import Workbench
from .section_picture import SectionPicture
from .section_quantities import (
    LARGEST_STRETCH,
    SECTION_QUANTITIES,
    PointValues,
    SectionQuantity,
    point_text,
)

_AXES = ("X", "Y", "Z")
_NO_CORD, _ANGLE = "choose a cord", "the angle below"
_HELP = "Drag the handle to move the section. Click on the section to see its numbers."


class SectionPanel:
    """Controls that choose the section.

    Attributes:
        on_change: Called after a user has changed a control; set by the mode.
        on_axis: Called with the axis (0 to 2) of a plane's button; set by the mode.
        on_plane: Called with the plane of a cord; set by the mode.
        on_offset: Called with an offset of the plane, mm; set by the mode.
        status: How to use the section, or why it is not shown.
        point: Numbers of the clicked point, or None.
    """

    def __init__(self, bench: Workbench) -> None:
        self._gui, self._sensors = bench.server.gui, tuple[Sensor, ...]()
        self.on_change: Callable[[], None] = _ignore
        self.on_axis: Callable[[int], None] = _ignore
        self.on_plane: Callable[[Plane], None] = _ignore
        self.on_offset: Callable[[float], None] = _ignore
        self.status = StatusText(_HELP)
        self.point: PointValues | None = None
        self.status.add_panel(self._gui)
        self._add_section_controls()
        self._add_direction_controls()
        self._bar = self._gui.add_html("")
        self._point_text = self._gui.add_markdown("")
        self._show_needed()

    def _add_section_controls(self) -> None:
        gui = self._gui
        self._quantity = self._watch(
            gui.add_dropdown(
                "Colors",
                [quantity.label for quantity in SECTION_QUANTITIES],
                initial_value=LARGEST_STRETCH.label,
                hint="Choose the quantity that the colors show",
            )
        )
        self._state = self._watch(
            gui.add_dropdown("State", ("rest",), hint="Choose rest or a simulated state")
        )
        self._axis = gui.add_button_group(
            "Normal", _AXES, hint="Put the plane in the middle, normal to an axis"
        )
        self._axis.on_click(lambda _: self.on_axis(_AXES.index(self._axis.value)))
        self._cord = gui.add_dropdown(
            "Plane of", (_NO_CORD,), hint="Put the plane on the plane of a cord"
        )
        on_user(self._cord, self._choose_cord)
        self._offset = gui.add_slider(
            "Offset (mm)",
            -1.0,
            1.0,
            0.1,
            0.0,
            hint="Move the plane along its normal, from the body's middle",
        )
        on_user(self._offset, lambda offset: self.on_offset(float(offset)))

    def _add_direction_controls(self) -> None:
        gui = self._gui
        self._along = self._watch(
            gui.add_dropdown(
                "Direction", (_ANGLE,), hint="Choose an angle or a cord's local direction"
            )
        )
        self._angle = self._watch(
            gui.add_slider(
                "Angle (°)",
                0,
                180,
                1,
                0,
                hint="Set the angle from the plane's x axis, the red arrow",
            )
        )
        self._state_range = self._watch(
            gui.add_checkbox(
                "Range of this state", False, hint="Fit the colors to this state instead of all"
            )
        )

    @property
    def quantity(self) -> SectionQuantity:
        """The quantity that the colors show."""
        return next(q for q in SECTION_QUANTITIES if q.label == self._quantity.value)

    @property
    def state(self) -> int:
        """Index of the state, 0 for rest."""
        return list(self._state.options).index(self._state.value)

    @property
    def angle(self) -> float:
        """Angle of the direction, radians."""
        return float(np.radians(self._angle.value))

    @property
    def direction_cord(self) -> Sensor | None:
        """The cord whose direction is used, or None for the angle."""
        return next((s for s in self._sensors if s.name == self._along.value), None)

    @property
    def has_state_range(self) -> bool:
        """Whether the range of the colors is that of this state alone."""
        return bool(self._state_range.value)

    @property
    def offset(self) -> float:
        """Offset of the plane along its normal, mm."""
        return float(self._offset.value)

    @property
    def max_offset(self) -> float:
        """Largest offset at which the plane meets the body, mm."""
        return float(self._offset.max)

    def set_states(self, states: Sequence[str], first: int) -> None:
        """Offer the states of a build.

        Args:
            states: Their names, rest first.
            first: Index of the state to show, unless a user's choice still exists.
        """
        was_offered = len(self._state.options) > 1 and self._state.value in states
        self._state.options = tuple(states)
        if not was_offered:
            self._state.value = states[first]

    def set_cords(self, sensors: Sequence[Sensor]) -> None:
        """Offer the cords of the device."""
        self._sensors = tuple(sensors)
        names = [sensor.name for sensor in sensors]
        for control, first in ((self._cord, _NO_CORD), (self._along, _ANGLE)):
            control.options = (first, *names)

    def choose(self, quantity: SectionQuantity, state: str = "rest") -> None:
        """Choose what the section shows."""
        self._quantity.value, self._state.value = quantity.label, state
        self._show_needed()

    def choose_next_state(self) -> None:
        """Choose the next state, and rest after the last."""
        states = list(self._state.options)
        self._state.value = states[(self.state + 1) % len(states)]

    def show_section(
        self, picture: SectionPicture, offset: float, limits: tuple[float, float]
    ) -> None:
        """Show the color bar of a section and the offset of its plane.

        Args:
            picture: The section.
            offset: Offset of its plane, mm.
            limits: Smallest and largest offset that meet the body, mm.
        """
        low, high = limits
        self.point = None
        self.status.show(_HELP)
        self._bar.content, self._point_text.content = picture.bar, ""
        self._offset.min, self._offset.max = round(low, 1), round(high, 1)
        self._offset.value = round(min(max(offset, low), high), 1)

    def show_point(self, values: PointValues, note: str = "") -> None:
        """Show the numbers of a point, and a note in markdown below them."""
        self.point = values
        self._point_text.content = point_text(values) + (f"  \n{note}" if note else "")

    def _watch(self, control: Any) -> Any:
        on_user(control, self._report_change)
        return control

    def _report_change(self, _: Any) -> None:
        self._show_needed()
        self.on_change()

    def _show_needed(self) -> None:
        """Show only the controls on which the chosen quantity depends."""
        quantity = self.quantity
        self._along.visible = quantity.needs_direction
        self._angle.visible = quantity.needs_direction and self.direction_cord is None
        self._state_range.visible = quantity.varies_by_state

    def _choose_cord(self, name: str) -> None:
        cord = next((s for s in self._sensors if s.name == name), None)
        if cord is not None:
            self.on_plane(cord.plane)
            self._cord.value = _NO_CORD  # so that the same cord can be chosen again


def _ignore(*_: Any) -> None:
    """Do nothing until the mode sets a callback."""
