"""Ports in place of the machine's."""


class Cable:
    """Ports of a machine on which devices are plugged in and pulled out."""

    def __init__(self, *names):
        self.there, self.sent, self.waiting, self.opened = list(names), [], [], []
        self.fails = 0  # of the next messages

    def names(self, inputs):
        return list(self.there)

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
