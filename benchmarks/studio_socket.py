"""Delays of the studio's answers over its socket, as a page asks for them."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.studio_server import SocketClient, first_event, load_average, open_studio

_DRAG_COUNT = 200  # movements of a control point
_SECTION_COUNT = 60  # planes, for each detail
_POSE_COUNT = 15  # angles of a pose, each solved to the end
_DRAG_MM = 3.0
_CHECK_COUNT = 8  # changes of a cord, after each of which the drawn cords are checked
_CHECK_DRAG_COUNT = 20  # movements of a control point during each check
_CHANGE_MM = 0.05
_CHECK_PAUSE_S = 0.7  # after which a check runs
_SECTION_SHARE = 0.05  # of the body's size, to both sides of the first plane
_TURN_DEG = 8.0


def measure_socket(device: Path) -> None:
    """Print delays of the studio of a device, whose poses are simulated.

    Args:
        device: Folder of a copy of the device, which is changed.
    """
    with open_studio(device) as studio:
        client = SocketClient(studio.port)
        state = client.event("device-state")
        seconds = time.monotonic() - studio.started_at
        print(f"{device.name}: page after {studio.page_time:.2f} s, device after {seconds:.2f} s")
        if not state["cords"]:
            client.ask("add-straight")
            state = first_event(studio.port, "device-state")
        _print_delays("dragged point to error", _drag_point(client, state["cords"][0]))
        delays = _drag_point_during_checks(client, studio.port, state["cords"][0])
        _print_delays("the same during a check", delays)
        for detail in ("coarse", "fine"):
            _print_delays(f"plane to {detail} section", _move_plane(client, studio.port, detail))
        coarse, fine = _turn_region(studio.port)
        _print_delays("pose to coarse shape", coarse)
        _print_delays("pose to fine shape", fine)
        client.close()


def _drag_point(client: SocketClient, cord: dict[str, Any], count: int = _DRAG_COUNT) -> np.ndarray:
    index, point = _dragged(cord)

    def drag(k: int) -> None:
        turn = 2 * np.pi * k / 40
        to = point.copy()
        to[:2] += _DRAG_MM * np.array([np.cos(turn), np.sin(turn)])
        answer = client.ask("drag-point", cord=cord["name"], index=index, to=to.tolist())
        if answer["result"]["judgement"] is None:
            raise RuntimeError("simulate the poses of the device first")

    return _times(drag, count)


def _drag_point_during_checks(client: SocketClient, port: int, cord: dict[str, Any]) -> np.ndarray:
    """Drag a point while another process makes the drawn cords on trial."""
    index, point = _dragged(cord)
    seconds = []
    for k in range(_CHECK_COUNT):
        to = point + (-1) ** k * _CHANGE_MM * np.eye(len(point))[0]
        client.ask("drag-point", cord=cord["name"], index=index, to=to.tolist(), write=True)
        time.sleep(_CHECK_PAUSE_S)
        if _check_state(port) == "checking":
            seconds.append(_drag_point(client, cord, _CHECK_DRAG_COUNT))
        while _check_state(port) == "checking":
            time.sleep(0.2)
    if not seconds:
        raise RuntimeError("the cords of the device break a limit, so that no check runs")
    return np.concatenate(seconds)


def _check_state(port: int) -> str:
    return str(first_event(port, "prediction")["check"]["state"])


def _dragged(cord: dict[str, Any]) -> tuple[int, np.ndarray]:
    index = min(2, len(cord["points"]) - 1)
    return index, np.array(cord["points"][index])


def _move_plane(client: SocketClient, port: int, detail: str) -> np.ndarray:
    inside = first_event(port, "inside-state")
    origin, axes = np.array(inside["origin"]), np.array(inside["axes"])
    quantity = inside["quantities"][0]["name"]

    def cut(k: int) -> None:
        shift = _SECTION_SHARE * inside["size"] * np.sin(2 * np.pi * k / _SECTION_COUNT)
        client.ask(
            "show-section", origin=(origin + shift * axes[2]).tolist(), axes=axes.tolist(),
            state=inside["firstState"], quantity=quantity, detail=detail,
        )  # fmt: skip

    return _times(cut, _SECTION_COUNT)


def _turn_region(port: int) -> tuple[np.ndarray, np.ndarray]:
    """Turn a region by small angles, each until the shape is solved."""
    client = SocketClient(port)
    poses = client.event("poses-state")["poses"]
    pose, handle = next(
        (pose, handle) for pose in poses for handle in pose["handles"] if handle["turn"] == "angle"
    )
    client.send("show-pose", pose=pose["name"])
    shape = client.receive(lambda m: m["kind"] == "pose-shape" and m["phase"] == "checked")
    position = shape["centers"].get(handle["region"], handle["center"])
    axis, coarse, fine = np.array(handle["axis"]), [], []
    for k in range(_POSE_COUNT):
        degrees = handle["degrees"] + _TURN_DEG * np.sin(2 * np.pi * k / _POSE_COUNT)
        sent_at = time.perf_counter()
        client.send(
            "move-grip", pose=pose["name"], region=handle["region"], pull=-1, position=position,
            rotation=(np.radians(degrees) * axis).tolist(),
        )  # fmt: skip
        is_first = True
        while True:
            arrays = client.receive(lambda m: m["kind"] == "arrays" and m["name"] == "pose-shape")
            if is_first:
                coarse.append(time.perf_counter() - sent_at)
                is_first = False
            if arrays["facts"]["phase"] != "coarse":
                break
        fine.append(time.perf_counter() - sent_at)
    client.close()
    return np.array(coarse), np.array(fine)


def _times(action: Callable[[int], None], count: int) -> np.ndarray:
    action(0)  # the first answer prepares what later ones reuse
    seconds = []
    for k in range(count):
        started_at = time.perf_counter()
        action(k)
        seconds.append(time.perf_counter() - started_at)
    return np.array(seconds)


def _print_delays(name: str, seconds: np.ndarray) -> None:
    median, largest = np.percentile(1e3 * seconds, [50, 95])
    print(f"  {name:24} {median:7.1f} ms (95 %: {largest:.1f} ms; load {load_average():.1f})",
          flush=True)  # fmt: skip
