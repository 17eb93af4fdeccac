"""Numbers and texts that no page sends are refused, whatever the request."""

from __future__ import annotations

import pytest

from defsense_fab.core.errors import DefsenseError
from defsense_fab.studio.messages import body, pose_edits, sensors, shell, start
from defsense_fab.studio.session.request_limits import check_values
from tests.support.errors import raises


@pytest.mark.parametrize(
    "request_",
    [
        sensors.DragPoint(id=1, cord="top", index=1, to=[0.0, -1e10]),
        sensors.DragPoint(id=1, cord="top", index=10**400, to=[0.0, 0.0]),
        sensors.AddStroke(id=1, origin=[0.0] * 3, axes=[], stroke=[[0.0, 1e300]]),
        pose_edits.SetShift(id=1, pose="bend", region="tip", shift=[None, float("inf"), 0.0]),
    ],
)
def test_numbers_whose_products_would_overflow_are_refused(request_):
    with pytest.raises(DefsenseError) as caught:
        check_values(request_)
    assert caught.value.code == "number-too-large"


@pytest.mark.parametrize(
    "request_",
    [
        shell.RenameDevice(id=1, name="x" * 121),
        sensors.DeleteCords(id=1, cords=["top", "x" * 5000]),
        body.SetField(id=1, key="x" * 5000, value=1.0),
        start.OpenDevice(id=1, folder="/" * 5000),
    ],
)
def test_long_texts_are_refused(request_):
    with raises(DefsenseError, "text-too-long"):
        check_values(request_)


def test_what_pages_send_is_accepted():
    check_values(shell.RenameDevice(id=10**400, name="x" * 120))
    check_values(start.KeepPicture(id=1, picture="data:image/png;base64," + "A" * 100_000))
    check_values(body.SetField(id=1, key="cord.modulus", value=1e12))  # its own limits
    check_values(pose_edits.SetGravity(id=1, pose="bend", gravity=[0.0, 0.0, -1.0]))
