"""The console and the radio of the boards, on streams and states that a test gives."""

import pytest

from tests.firmware.micropython.conftest import PROGRAM


def test_all_modules_compile(run_scenario):
    sources = [path.read_text("utf-8") for path in PROGRAM.glob("*.py")]
    assert run_scenario("compile_modules", sources) == len(sources) > 10


def test_console_neither_waits_nor_exceeds_the_baud_rate(run_scenario):
    chunks, at_once, none_left, in_a_second, written, while_closed = run_scenario(
        "use_console", "rate 50\nframes\nx"
    )
    assert "".join(chunks) == "rate 50\nframes\nx"
    assert (at_once, none_left, while_closed) == (64, 0, 0)
    assert in_a_second == pytest.approx(11520, rel=0.05)
    assert written == at_once + in_a_second


@pytest.mark.parametrize(
    ("family", "codes", "settings"),
    [
        # ESP32: constants of network.WLAN and reasons of esp_wifi_types.h.
        (
            "esp32",
            {1001: "joining", 1010: "joined", 202: "wrong-password", 15: "wrong-password",
             204: "wrong-password", 201: "not-found", 212: "not-found", 1000: "failed",
             8: "failed"},
            [["pm", 7], ["reconnects", 0]],
        ),
        # Pico W: constants of cyw43.h.
        (
            "rp2",
            {1: "joining", 2: "joining", 3: "joined", -3: "wrong-password", -2: "not-found",
             -1: "failed", 0: "failed"},
            [["pm", 7]],
        ),
    ],
)  # fmt: skip
def test_states_of_the_radio(run_scenario, family, codes, settings):
    states, calls, address, last = run_scenario("use_radio", [family, list(codes)])
    assert states == list(codes.values())
    assert address == "192.168.1.20"
    first = [["active", True], *settings, ["connect", "lab", "secret"]]
    # An attempt that still runs is ended before the next one.
    second = [["active", True], *settings, ["disconnect"], ["connect", "lab", None]]
    assert calls[: len(first) + len(second)] == first + second
    assert last == "failed"
