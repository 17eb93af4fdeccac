"""The studio in another process, its memory and processor time, and a client of its socket."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
HOST = "127.0.0.1"
TIMEOUT_S = 300.0
_CLOCK_HZ = os.sysconf("SC_CLK_TCK")


class Studio:
    """A running studio.

    Args:
        folder: Folder of the device.
        checkout: Folder of the code.

    Attributes:
        port: Port of the page.
        process: The program.
        started_at: Time of its start, as `time.monotonic`.
    """

    def __init__(self, folder: Path, checkout: Path = ROOT) -> None:
        with socket.socket() as probe:
            probe.bind((HOST, 0))
            self.port: int = probe.getsockname()[1]
        words = ["studio", str(folder), "--port", str(self.port), "--no-browser", "--trust"]
        threads = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        environment = {**os.environ, "PYTHONPATH": str(checkout), **threads}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # as on a user's machine
        self.started_at = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "defsense_fab", *words],
            cwd=checkout,
            env=environment,
            stdout=subprocess.DEVNULL,
        )
        while True:
            try:
                urllib.request.urlopen(f"{self.url}/").close()
            except OSError:
                if self.process.poll() is not None:
                    raise RuntimeError("the studio has ended") from None
                time.sleep(0.01)
            else:
                break
        #: Time from the start to the answered page, s.
        self.page_time = time.monotonic() - self.started_at

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.port}"

    def close(self) -> None:
        """End the program."""
        self.process.terminate()
        self.process.wait()


@contextmanager
def open_studio(folder: Path, checkout: Path = ROOT) -> Iterator[Studio]:
    """Run the studio of a folder until the block ends."""
    studio = Studio(folder, checkout)
    try:
        yield studio
    finally:
        studio.close()


class SocketClient:
    """A browser without a page: it sends requests and receives all messages."""

    def __init__(self, port: int) -> None:
        from websockets.sync.client import connect

        origin = f"http://{HOST}:{port}"
        self._socket = connect(f"ws://{HOST}:{port}/socket", origin=origin, max_size=None)  # type: ignore[arg-type]
        self._numbers = itertools.count(1)

    def send(self, kind: str, **content: Any) -> int:
        """Send a request, and return its number."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"kind": kind, "id": number, **content}))
        return number

    def receive(self, is_wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the next message for which a function is true; of arrays, the header.

        Raises:
            TimeoutError: No such message arrives.
        """
        deadline = time.monotonic() + TIMEOUT_S
        while True:
            message = self._socket.recv(timeout=max(deadline - time.monotonic(), 0.0))
            content = _header(message) if isinstance(message, bytes) else json.loads(message)
            if is_wanted(content):
                return content

    def event(self, kind: str) -> dict[str, Any]:
        """Return the next event of a kind."""
        return self.receive(lambda message: message["kind"] == kind)

    def ask(self, kind: str, **content: Any) -> dict[str, Any]:
        """Send a request, and return its answer.

        Raises:
            RuntimeError: The studio refuses it.
        """
        number = self.send(kind, **content)
        answer = self.receive(lambda m: m["kind"] in ("reply", "arrays") and m["id"] == number)
        if answer.get("problem"):
            raise RuntimeError(f"{kind}: {answer['problem']['message']}")
        return answer

    def drain(self, seconds: float) -> None:
        """Receive and drop a message, if one comes in time."""
        try:
            self._socket.recv(timeout=seconds)
        except TimeoutError:
            return

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def first_event(port: int, kind: str) -> dict[str, Any]:
    """Return the newest event of a kind, as a browser that connects gets it."""
    client = SocketClient(port)
    try:
        return client.event(kind)
    finally:
        client.close()


def _header(message: bytes) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
    return content


def copy_device(device: Path, folder: Path) -> Path:
    """Copy a device, with its build, into a folder."""
    copy = folder / device.resolve().name
    shutil.copytree(device, copy)
    return copy


def process_tree(root: int) -> list[int]:
    """Return the numbers of a process and of all its descendants."""
    children: dict[int, list[int]] = {}
    for path in Path("/proc").iterdir():
        if path.name.isdigit():
            fields = _stat(int(path.name))
            if fields:
                children.setdefault(int(fields[1]), []).append(int(path.name))
    found = [root]
    for number in found:
        found += children.get(number, [])
    return found


def processor_seconds(processes: list[int]) -> float:
    """Return the CPU time that processes have used, s."""
    stats = [fields for number in processes if (fields := _stat(number))]
    return sum(int(fields[11]) + int(fields[12]) for fields in stats) / _CLOCK_HZ


def memory_mb(processes: list[int]) -> float:
    """Return the memory of processes, MB; pages that they share count once."""
    total = 0
    for number in processes:
        try:
            text = Path(f"/proc/{number}/smaps_rollup").read_text(encoding="ascii")
        except OSError:  # it has ended
            continue
        total += int(next(x for x in text.splitlines() if x.startswith("Pss:")).split()[1])
    return total / 1024


def load_average() -> float:
    """Return the number of processes that wanted a core in the last minute."""
    return os.getloadavg()[0]


def _stat(number: int) -> list[str]:
    """Return the fields of a process from its state on; none if it has ended."""
    try:
        text = Path(f"/proc/{number}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return []
    return text[text.rindex(")") + 2 :].split()
