"""Test frames with the golden bytes of the firmware's tests, and with every kind of damage."""

import os
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.sensing.serial_frames import Info, Sample, Stream, Text, decode, encode
from tests.support.places import FIRMWARE

GOLDEN = FIRMWARE / "golden.txt"
LINES = [
    line.split()
    for line in GOLDEN.read_text("utf-8").splitlines()
    if line and not line.startswith("#")
]
#: Number of damaged frames.
FAULTS = int(os.environ.get("DEFSENSE_FAULTS", "3000"))


@pytest.mark.parametrize(("name", "payload", "frame"), LINES, ids=[n for n, *_ in LINES])
def test_golden_frames(name, payload, frame):
    frame = bytes.fromhex(frame)
    message = decode(frame[:-1])
    assert type(message) is {"sample": Sample, "info": Info, "text": Text}[name.split("_")[0]]
    assert encode(message) == frame
    assert 0 not in frame[:-1]


def test_values_of_a_golden_frame():
    frame = bytes.fromhex(dict((n, f) for n, _, f in LINES)["sample_3"])
    assert decode(frame[:-1]) == Sample(17, 345678, True, False, 16, (8196, 4800, 12000))


def samples(rng, count, channels):
    out = []
    for i in range(count):
        sums = tuple(rng.randrange(16 * 1023) for _ in range(channels))
        out.append(Sample(i, i * 20_000 % 2**32, bool(i // 25 % 2), False, 16, sums))
    return out


def damage(rng, frame, kind):
    frame = bytearray(frame)
    at = rng.randrange(len(frame))
    if kind == "flip":
        frame[at] ^= 1 << rng.randrange(8)
    elif kind == "change":
        frame[at] = (frame[at] + rng.randrange(1, 256)) % 256
    elif kind == "drop":
        del frame[at]
    elif kind == "insert":
        frame.insert(at, rng.randrange(256))
    else:  # a burst of noise
        frame[at : at + rng.randrange(1, 9)] = rng.randbytes(rng.randrange(1, 9))
    return bytes(frame)


@pytest.mark.parametrize("channels", [1, 3, 16])
def test_damaged_frames_are_never_accepted(channels):
    """Two frames after a fault all samples arrive again."""
    rng = random.Random(channels)
    sent = samples(rng, 3 * FAULTS, channels)
    hit = set(rng.sample(range(len(sent)), FAULTS))
    kinds = ("flip", "change", "drop", "insert", "burst")
    data = b"".join(
        damage(rng, encode(s), rng.choice(kinds)) if i in hit else encode(s)
        for i, s in enumerate(sent)
    )
    stream, received = Stream(), []
    while data:
        size = rng.randrange(1, 200)
        received += stream.feed(data[:size])
        data = data[size:]
    assert set(received) <= set(sent)
    assert [s.counter for s in received] == sorted({s.counter for s in received})
    there = {s.counter for s in received}
    for i in range(2, len(sent) - 1):
        if not {i, i - 1, i - 2} & hit:
            assert i in there, "a frame was lost two frames after the last fault"
    # Until the first unconfirmed sample, all missing samples were counted as lost.
    assert stream.lost == received[-1].counter - received[0].counter + 1 - len(received)
    assert stream.bad > 0.9 * len(hit) - 10


VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "60"))


@settings(max_examples=VARIANTS, derandomize=True, deadline=None)
@given(
    first=st.integers(0, 2**32 - 1),
    kinds=st.lists(
        st.sampled_from(["whole", "whole", "whole", "flip", "change", "drop", "burst", "never"]),
        min_size=3,
        max_size=120,
    ),
    channels=st.integers(1, 16),
    chunk=st.integers(1, 300),
    rng=st.randoms(use_true_random=False),
)
def test_lost_samples_are_counted_as_they_were_sent(first, kinds, channels, chunk, rng):
    data, whole = b"", []
    for k, kind in enumerate(["whole", "whole", *kinds, "whole", "whole"]):
        counter = (first + k) % 2**32
        sums = tuple(rng.randrange(16 * 1024) for _ in range(channels))
        sent = Sample(counter, 20_000 * k, False, False, 16, sums)
        frame = encode(sent)
        if kind not in ("whole", "never"):
            frame = damage(rng, frame, kind)
        if kind != "never":
            data += frame
            whole += [sent] * (frame == encode(sent))
    stream, received = Stream(), []
    for at in range(0, len(data), chunk):
        received += stream.feed(data[at : at + chunk])
    assert set(received) <= set(whole)
    span = (received[-1].counter - received[0].counter) % 2**32 + 1
    assert stream.lost == span - len(received)
    assert (received[0], received[-1]) == (whole[0], whole[-1])
    # A damaged end joins two frames, so a damaged frame may take its neighbor with it.
    damaged = sum(kind not in ("whole", "never") for kind in kinds)
    assert 0 <= stream.lost - (len(kinds) + 4 - len(whole)) <= damaged
    assert stream.restarts == 0


def test_noise_contains_no_messages():
    rng = random.Random(0)
    stream = Stream()
    assert stream.feed(rng.randbytes(200_000)) == []
    assert stream.bad > 500


def test_restarted_board_needs_a_second_sample():
    stream = Stream()
    one, two = ([Sample(n, 0, False, False, 1, (5,)) for n in range(a, a + 3)] for a in (5000, 0))
    assert stream.feed(b"".join(map(encode, one))) == one
    assert stream.feed(encode(two[0])) == []
    assert stream.feed(encode(two[1])) == two[:2]
    assert stream.restarts == 1


def test_messages_that_boards_never_send_are_refused():
    good = Sample(1, 2, True, False, 16, (100, 200))
    assert decode(encode(good)[:-1]) == good
    for bad in (
        Sample(1, 2, True, False, 0, (100,)),
        Sample(1, 2, True, False, 1, (40_000,)),
        Sample(1, 2, True, False, 1, ()),
        Sample(1, 2, True, False, 1, (1,) * 17),
        Text("x" * 101),
        Text("\x07"),
    ):
        assert decode(encode(bad)[:-1]) is None
    assert decode(b"") is None


def test_other_protocol_is_recognized_by_its_number():
    info = Info(2, (9, 9), 0, 3, 16, 50, 0, 8, 1024)
    assert decode(encode(info)[:-1]).protocol == 2
