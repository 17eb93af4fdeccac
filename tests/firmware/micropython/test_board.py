"""The program on simulated hardware: samples, commands, silent chips and slow ports."""

import re

import numpy as np
import pytest

from defsense_fab.sensing.serial_frames import NOT_READ, Info, Sample, Stream, Text

FRAMES = [0, "frames\n"]


def run(run_scenario, **case):
    result = run_scenario("run_board", {"chips": [0x48], "seconds": 1, "commands": [], **case})
    stream = Stream()
    result["bytes"] = bytes.fromhex(result["sent"])
    messages = stream.feed(result["bytes"])
    result["stream"] = stream
    result["infos"] = [m for m in messages if isinstance(m, Info)]
    result["samples"] = [m for m in messages if isinstance(m, Sample)]
    result["texts"] = [m.text for m in messages if isinstance(m, Text)]
    return result


def expected_sums(conversions, channels, first_us, last_us):
    """Return the sums of the conversions that started in an interval; codes below 0 are 0."""
    sums = np.zeros(channels, int)
    for chip, rows in enumerate(conversions.values()):
        for at, source, code in rows:
            if first_us <= at < last_us and 4 * chip + source < channels:
                sums[4 * chip + source] += max(code, 0)
    return tuple(sums.tolist())


@pytest.mark.parametrize(
    ("chips", "channels", "averages", "rate"),
    [([0x48], 3, 1, 50), ([0x4A], 4, 4, 30), ([0x48, 0x49, 0x4A, 0x4B], 16, 1, 60)],
)
def test_samples_are_the_sums_of_the_conversions(run_scenario, chips, channels, averages, rate):
    commands = f"channels {channels}\naverage {averages}\nrate {rate}\nframes\n"
    done = run(run_scenario, chips=chips, commands=[[0, commands]], seconds=3)
    assert done["infos"][-1] == Info(
        1, (1, 0), 1, channels, averages, rate, 1000, 4 * len(chips), 26400
    )
    samples = [s for s in done["samples"] if (len(s.sums), s.averages) == (channels, averages)]
    assert (done["stream"].lost, done["stream"].bad) == (0, 1)  # the plain lines before
    assert len(samples) > 2.5 * rate
    half = 500_000 // rate
    for sample in samples[2:]:
        window = sample.micros - half, sample.micros + half
        assert sample.sums == expected_sums(done["conversions"], channels, *window)
    times = np.array([s.micros for s in samples])
    assert np.diff(times).mean() == pytest.approx(1e6 / rate, rel=1e-3)
    assert abs(np.diff(times) - 1e6 / rate).max() < 1500
    assert not any(s.late for s in samples[2:])


def test_chips_convert_at_the_same_time(run_scenario):
    done = run(run_scenario, chips=[0x48, 0x49, 0x4A, 0x4B], commands=[[0, "channels 16\n"]])
    starts = [[at for at, _, _ in rows[-40:]] for rows in done["conversions"].values()]
    assert np.ptp(starts, axis=0).max() < 1000  # one conversion takes 1163 us


@pytest.mark.slow
def test_microseconds_continue_where_the_counter_wraps(run_scenario):
    """The simulated counter wraps after 16.8 s."""
    done = run(run_scenario, commands=[[0, "rate 2\nframes\n"]], seconds=18)
    times = [s.micros for s in done["samples"]]
    assert times[-1] > 17e6
    assert (np.diff(times[2:]) > 0).all()
    assert np.diff(times[3:]) == pytest.approx(500_000, abs=1500)


def test_rates_that_do_not_divide_a_second_do_not_drift(run_scenario):
    done = run(run_scenario, commands=[[0, "channels 1\nrate 30\nframes\n"]], seconds=11)
    samples = done["samples"][2:]
    duration = samples[-1].micros - samples[0].micros
    steps = samples[-1].counter - samples[0].counter
    assert duration == pytest.approx(steps * 1e6 / 30, abs=1000)


def test_late_samples_are_flagged_and_missed_slots_counted(run_scenario):
    """A rate that the converter cannot keep, and a board that is busy for 50 ms."""
    slow = run(run_scenario, commands=[[0, "rate 400\nframes\n"]])
    counters = [s.counter for s in slow["samples"]]
    assert any(s.late for s in slow["samples"])
    assert (np.diff(counters) > 1).any()
    # 400 slots a second are counted, and about 215 samples of 4.6 ms fit.
    assert counters[-1] - counters[0] > 350
    busy = run(run_scenario, commands=[FRAMES], seconds=2, busy=[1_000_000])
    late = [s for s in busy["samples"] if s.late]
    assert len(late) == 1
    assert 1_000_000 < late[0].micros < 1_100_000
    position = busy["samples"].index(late[0])
    assert late[0].counter - busy["samples"][position - 1].counter in (2, 3)


def test_channels_of_a_silent_chip_are_not_read(run_scenario):
    done = run(
        run_scenario,
        chips=[0x48, 0x49],
        silent={str(0x48): 1_000_000},
        commands=[[0, "channels 8\nframes\n"]],
        seconds=2,
    )
    last = done["samples"][-1].sums
    assert last[:4] == (NOT_READ,) * 4
    assert all(s != NOT_READ for s in last[4:])
    assert all(s != NOT_READ for s in done["samples"][5].sums)


def test_missing_converter_is_reported(run_scenario):
    done = run(run_scenario, chips=[], commands=[FRAMES], seconds=3)
    assert (done["infos"][0].channels, done["infos"][0].most_channels) == (0, 0)
    assert done["samples"] == []
    assert len(done["texts"]) in (2, 3)
    assert "ADS1115" in done["texts"][0]


def test_commands_and_their_answers(run_scenario):
    """Each command is answered by an info if it was carried out, and by a text if not."""
    commands = {
        "version": "info", "rate 500": "info", "rate 501": "text", "rate 0": "text",
        "rate": "text", "rate -1": "text", "rate 1x": "text", "rate 000001": "text",
        "channels 4": "info", "channels 5": "text", "average 255": "info", "average 256": "text",
        "average 1": "info", "led 65535": "info", "led 65536": "text", "led on": "info",
        "led off": "info", "led 0": "info", "help": "text", "frame": "text", "Rate 5": "text",
        "x" * 40: "text", "x" * 41: "text", "ra\x07te 5": "text",
        "wifi a": "text", "key none": "text", "network": "text", "rate 50": "info",
    }  # fmt: skip
    times = range(100_000, 10_000_000, 50_000)
    given = [[at, f"{c}\r\n"] for at, c in zip(times, commands, strict=False)]
    done = run(run_scenario, commands=[FRAMES, *given], seconds=6)
    kinds = [
        "info" if isinstance(message, Info) else "text"
        for message in Stream().feed(done["bytes"])
        if not isinstance(message, Sample)
    ]
    assert kinds == ["info", *commands.values()]
    last = done["infos"][-1]
    assert (last.rate, last.channels, last.averages, last.led_period) == (50, 4, 1, 0)
    assert "unknown command, try help" in done["texts"]


def test_plain_lines_before_frames_and_after_plain(run_scenario):
    commands = [[500_000, "version\nframes\n"], [1_000_000, "plain\nhelp\n"]]
    done = run(run_scenario, commands=commands, seconds=1.5)
    start, _, rest = done["bytes"].partition(b"\0")
    lines = start.decode().splitlines()
    samples = [line for line in lines if not line.startswith("#")]
    assert len(samples) >= 24
    number = r"\d+\.\d\d"
    assert all(re.fullmatch(f"A0:{number},A1:{number},A2:{number}", s) for s in samples[:-1])
    first = expected_sums(done["conversions"], 3, 0, 10_000)
    assert samples[0] == ",".join(f"A{n}:{s}.00" for n, s in enumerate(first))
    answers = [line for line in lines if line.startswith("#")]
    assert len(answers) == 1
    assert answers[0].startswith("# defsense 1.0 ads1115, protocol 1, 3 of 4 channels")
    end = rest.rpartition(b"\0")[2].decode().splitlines()
    assert end[1].startswith("# defsense 1.0")
    assert end[2].startswith("# frames, plain, rate N")
    assert re.fullmatch(f"A0:{number},A1:{number},A2:{number}", end[4])


def test_led_blinks_and_its_state_is_in_the_samples(run_scenario):
    commands = [[0, "led 100\nframes\n"], [1_000_000, "led on\n"], [1_500_000, "led off\n"]]
    done = run(run_scenario, commands=commands, seconds=2)
    changes = np.array([at for at, _ in done["led"] if 200_000 < at < 1_000_000])
    assert np.diff(changes) == pytest.approx(100_000, abs=3000)
    for sample in done["samples"]:
        state = [on for at, on in done["led"] if at <= sample.micros]
        moved = [at for at, _ in done["led"] if abs(at - sample.micros) < 5000]
        assert moved or sample.led == state[-1]
    assert done["led"][-1][1] is False


def test_port_that_nobody_reads_stops_neither_sampling_nor_led(run_scenario):
    done = run(run_scenario, commands=[FRAMES], stops_at=500_000, seconds=3)
    assert len(done["samples"]) < 40
    assert len(done["conversions"][str(0x48)]) > 3 * 140
    assert done["led"][-1][0] > 1_900_000


def test_port_that_is_too_slow_loses_samples_but_no_answers(run_scenario):
    """16 channels at 60 Hz are 64 bytes each; plain lines of 16 channels are longer than that."""
    commands = [[0, "channels 16\nrate 100\n"], [1_000_000, "version\n"]]
    chips = [0x48, 0x49, 0x4A, 0x4B]
    done = run(run_scenario, chips=chips, commands=commands, seconds=2)
    assert sum(line.startswith("# defsense") for line in done["bytes"].decode().splitlines()) == 3


@pytest.mark.parametrize(
    ("kind", "full_scale", "counts"), [("pico", 4096, [100, 200]), ("esp32", 26400, [1600, 3200])]
)
def test_internal_converters(run_scenario, kind, full_scale, counts):
    """Counts of 12 bits on a Pico, and of 0.125 mV on an ESP32."""
    done = run(run_scenario, internal=2, kind=kind, commands=[FRAMES])
    info = done["infos"][0]
    assert (info.converter, info.channels, info.averages) == (0, 2, 16)
    assert info.full_scale == full_scale
    assert list(done["samples"][-1].counts) == counts
