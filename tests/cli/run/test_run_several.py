"""`defsense run` with several devices: what each of them is asked for."""

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
    wired: tuple = ("a",)


@pytest.fixture
def prepared(monkeypatch):
    """Names and settings with which devices are run, by the arguments of the command."""
    made = []

    def prepare(live, asked, _):
        made.append((live.model.device, asked))
        return SimpleNamespace()

    monkeypatch.setattr(
        "defsense_fab.runtime.live.live_device.live_device",
        lambda path, _: Live(Model(path.parent.name), SimpleNamespace(source=path.parent)),
    )
    monkeypatch.setattr("defsense_fab.runtime.live.live_run.live_run", prepare)

    def command(*arguments):
        options = make_parser().parse_args(["run", *map(str, arguments)])
        several = OutputAllocator()
        for k in range(len(options.models)):
            run._prepare(options, k, silent, several)
        return made

    return command


def test_devices_by_one_command(prepared, tmp_path):
    """A flag and a live.toml that both are given are counted on; one of its own stays."""
    for name in ("bar", "cube"):
        (tmp_path / name).mkdir()
    (tmp_path / "bar" / "live.toml").write_text("[outputs.websocket]\n")
    (tmp_path / "cube" / "live.toml").write_text("[outputs.websocket]\nport = 9100\n")
    models = [tmp_path / name / "model.json" for name in ("bar", "cube", "bar")]
    found = prepared(*models, "--port", "a", "b", "c", "--view", "--output", "osc")
    assert [name for name, _ in found] == ["bar", "cube", "bar-2"]
    outputs = [asked.outputs for _, asked in found]
    assert [[o.port for o in each] for each in outputs] == [
        [8765, 9000],
        [9100, 9000],
        [8766, 9000],
    ]
    assert [osc.wekinator_port for _, osc in outputs] == [6448, 6449, 6450]
    assert [asked.view for _, asked in found] == [8080, 8081, 8082]
