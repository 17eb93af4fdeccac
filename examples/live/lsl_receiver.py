"""Print the channels of a Lab Streaming Layer stream of the type Deformation.

    defsense run my-device/model.json --port twin --output lsl         # in one terminal
    pip install pylsl
    python lsl_receiver.py                                             # in another
    python lsl_receiver.py bar-2                                       # the stream of that name

LabRecorder records the same stream together with EEG, motion capture and others, on one clock.
"""

import contextlib
import sys

import pylsl


def labels(info):
    """Return label and unit of each channel."""
    channel, out = info.desc().child("channels").child("channel"), []
    for _ in range(info.channel_count()):
        out.append((channel.child_value("label"), channel.child_value("unit")))
        channel = channel.next_sibling()
    return out


def main():
    query = ("name", sys.argv[1]) if len(sys.argv) > 1 else ("type", "Deformation")
    streams = pylsl.resolve_byprop(*query, 1, 30)
    if not streams:
        sys.exit(
            f"no stream of the {' '.join(query)} within 30 s; does the live loop run, and did the"
            " device lie at rest?"
        )
    inlet = pylsl.StreamInlet(streams[0])
    names = labels(inlet.info(10))
    print(f"stream {streams[0].name()!r}:", ", ".join(f"{n} ({u})" for n, u in names), flush=True)
    while True:
        values, stamp = inlet.pull_sample(10)
        if values is None:
            sys.exit("nothing for 10 s")
        row = "  ".join(f"{n} {v:+.2f}" for (n, _), v in zip(names, values, strict=True))
        print(f"{stamp:12.3f}  {row}", flush=True)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
