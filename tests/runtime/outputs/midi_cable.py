"""Simulated MIDI ports, and frames to send to them."""

from tests.runtime.live_frames import frame


class Cable:
    """The ports of a machine whose devices are plugged in and unplugged."""

    def __init__(self, *names):
        self.plugged, self.sent, self.waiting, self.opened = list(names), [], [], []
        self.fails = 0  # number of the next messages that fail

    def names(self, inputs):
        return list(self.plugged)

    def open(self, name, inputs, virtual=False):
        self.opened.append((name, inputs, virtual))
        return self

    def send(self, message):
        if self.fails:
            self.fails -= 1
            raise OSError("cable pulled")
        self.sent.append(tuple(message))

    def pending(self):
        out, self.waiting = self.waiting, []
        return out

    def close(self):
        self.opened.append("closed")


def moved(values, **kwargs):
    """Return frames in which `bend` has these values, 10 ms apart."""
    return [frame(n, controls={"bend": v}, confidence={}, **kwargs) for n, v in enumerate(values)]
