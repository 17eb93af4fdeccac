"""`defsense run` with several devices: the settings of each."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from defsense_fab.cli.main import parse, run_command
from defsense_fab.core.errors import DeviceError, LiveError
from tests.support.errors import raises


@dataclass
class Model:
    device: str


@dataclass
class Live:
    model: Model
    device: SimpleNamespace
    board_channels: tuple = ("a",)


class PreparedError(Exception):
    """All devices were prepared, and none is started."""


@pytest.fixture
def prepared(monkeypatch):
    """A function that returns the names and arguments of the devices of a command."""
    devices = []

    def prepare(live, port, options, **more):
        if len(devices) == len(prepare.ports) - 1:
            devices.append((live.model.device, port, options, more))
            raise PreparedError
        devices.append((live.model.device, port, options, more))
        return SimpleNamespace(end=lambda: None, animations=None)

    monkeypatch.setattr(
        "defsense_fab.workflow.run.live_device.live_device",
        lambda path, _: Live(Model(path.parent.name), SimpleNamespace(source=path.parent)),
    )
    monkeypatch.setattr("defsense_fab.workflow.run.run.prepare_run", prepare)

    def command(models, ports, *more):
        prepare.ports = ports
        words = ["run", *map(str, models), "--port", *ports, *more]
        with pytest.raises(PreparedError):
            run_command(words)
        return devices

    return command


def options_of(*words):
    _, bound = parse(["run", *words])
    return bound.arguments


def test_ports_and_names_of_several_devices(prepared, tmp_path):
    """Ports of flags and live.toml files are numbered; an explicit port stays."""
    for name in ("bar", "cube"):
        (tmp_path / name).mkdir()
    (tmp_path / "bar" / "live.toml").write_text("[outputs.websocket]\n")
    (tmp_path / "cube" / "live.toml").write_text("[outputs.websocket]\nport = 9100\n")
    models = [tmp_path / name / "model.json" for name in ("bar", "cube", "bar")]
    devices = prepared(models, ("a", "b", "c"), "--view", "--output", "osc")
    assert [name for name, *_ in devices] == ["bar", "cube", "bar-2"]
    assert [port for _, port, *_ in devices] == ["a", "b", "c"]
    outputs = [more["settings"].outputs for *_, more in devices]
    assert [[o.port for o in each] for each in outputs] == [
        [8765, 9000],
        [9100, 9000],
        [8766, 9000],
    ]
    assert [osc.wekinator_port for _, osc in outputs] == [6448, 6449, 6450]
    assert [more["view"] for *_, more in devices] == [8080, 8081, 8082]


def test_each_device_has_its_own_files(prepared, tmp_path):
    words = ("--record", "rec", "--animation", "a.glb", "--no-record")
    devices = prepared([tmp_path / "bar", tmp_path / "cube"], ("a", "b"), *words)
    assert [str(options.record) for _, _, options, _ in devices] == ["rec", "rec-2"]
    assert [str(options.animation) for _, _, options, _ in devices] == ["a.glb", "a-2.glb"]
    assert not any(more["keeps_readings"] for *_, more in devices)


def test_all_flags_are_read():
    given = options_of(
        *("a", "b", "--port", "twin:seed=7,cut=A@20-30", "COM3", "--view", "9000"),
        *("--output", "osc,port=9000", "--output", "midi", "--no-browser", "--no-fallback"),
        *("--rest", "1500,900", "--reference", "2200", "--surface", "arap", "--rate", "50"),
        *("--device", "x", "y", "--seconds", "40", "--live", "live.toml"),
    )
    assert [str(path) for path in given["models"]] == ["a", "b"]
    assert given["port"] == ("twin:seed=7,cut=A@20-30", "COM3")
    assert [str(path) for path in given["device"]] == ["x", "y"]
    show, options = given["show"], given["options"]
    assert (show.page(0), show.page(1), show.browser, show.seconds) == (9000, 9001, False, 40.0)
    assert show.output == ("osc,port=9000", "midi")
    assert (options.rest, options.reference) == ((1500.0, 900.0), (2200.0,))
    assert (options.surface, options.rate, options.fallback) == ("arap", 50, False)


def test_page_is_shown_only_with_view():
    assert "show" not in options_of("a", "--port", "twin")
    show = options_of("a", "--port", "twin", "--view", "--no-browser")["show"]
    assert show.page(0) == 8080


@pytest.mark.parametrize(
    ("words", "kind", "code"),
    [
        (("--port", "a"), DeviceError, "count-differs"),
        (("--port", "a", "b", "--device", "x"), DeviceError, "count-differs"),
        (("--port", "a", "b", "--rate", "5"), LiveError, "out-of-range"),
        (("--port", "a", "b", "--view", "80"), DeviceError, "out-of-range"),
        (("--port", "a", "b", "--view", "65535"), DeviceError, "out-of-range"),
        (("--port", "a", "b", "--rest", "0"), LiveError, "out-of-range"),
        (("--port", "a", "b", "--view", "x"), DeviceError, "argument-invalid"),
        ((), DeviceError, "argument-missing"),
    ],
)
def test_invalid_flags_are_refused(words, kind, code):
    with raises(kind, code):
        run_command(["run", "m", "n", *words])
