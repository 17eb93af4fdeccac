"""`defsense run` with several devices: the settings of each."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from defsense_fab.cli.main import make_parser
from defsense_fab.cli.run import run
from defsense_fab.core.progress import silent
from defsense_fab.runtime.outputs.output_allocation import OutputAllocator


@dataclass
class Model:
    device: str


@dataclass
class Live:
    model: Model
    device: SimpleNamespace
    board_channels: tuple = ("a",)


@pytest.fixture
def prepared(monkeypatch):
    """A function that returns the names and settings of the devices of a command."""
    prepared_devices = []

    def prepare(live, settings, _):
        prepared_devices.append((live.model.device, settings))
        return SimpleNamespace()

    monkeypatch.setattr(
        "defsense_fab.runtime.live.live_device.live_device",
        lambda path, _: Live(Model(path.parent.name), SimpleNamespace(source=path.parent)),
    )
    monkeypatch.setattr("defsense_fab.runtime.live.live_run.live_run", prepare)

    def command(*arguments):
        options = make_parser().parse_args(["run", *map(str, arguments)])
        allocator = OutputAllocator()
        for k in range(len(options.models)):
            run._prepare(options, k, silent, allocator)
        return prepared_devices

    return command


def test_ports_and_names_of_several_devices(prepared, tmp_path):
    """Ports of flags and live.toml files are numbered; an explicit port stays."""
    for name in ("bar", "cube"):
        (tmp_path / name).mkdir()
    (tmp_path / "bar" / "live.toml").write_text("[outputs.websocket]\n")
    (tmp_path / "cube" / "live.toml").write_text("[outputs.websocket]\nport = 9100\n")
    models = [tmp_path / name / "model.json" for name in ("bar", "cube", "bar")]
    devices = prepared(*models, "--port", "a", "b", "c", "--view", "--output", "osc")
    assert [name for name, _ in devices] == ["bar", "cube", "bar-2"]
    outputs = [settings.outputs for _, settings in devices]
    assert [[o.port for o in each] for each in outputs] == [
        [8765, 9000],
        [9100, 9000],
        [8766, 9000],
    ]
    assert [osc.wekinator_port for _, osc in outputs] == [6448, 6449, 6450]
    assert [settings.view for _, settings in devices] == [8080, 8081, 8082]
