"""A device's file as a user writes it, and a page as a browser and its jobs use it."""

from types import SimpleNamespace

from defsense_fab.core.errors import DefsenseError

TEXT = """\
# A grip that knows how it is held.
schema = 1
name = "grip"  # as on the box

[body]
script = "grip.py"
parameters = { length = 150, width = 30 }  # mm

[material]
name = "ninjaflex-85a"

[mesh]
edge_length = 6.0

[regions]
base = { box = [[-1, -16, -16], [10, 16, 16]] }
tip = { box = [[140, -16, -16], [151, 16, 16]] }  # what the hand moves

[[poses]]
name = "bend"
fixed = ["base"]
[[poses.handles]]
region = "tip"
rotate = { axis = [0, 1, 0], degrees = -30 }
translate = "free"

[[poses]]
name = "twist"   # about its length
fixed = ["base"]
[[poses.handles]]
region = "tip"
rotate = { axis = [1, 0, 0], degrees = 45, about = [145, 0, 0] }

[states]
ramp = [0.5, 1.0]
mixtures = [{ bend = 0.5, twist = 0.5 }]
held_out = [{ bend = 0.7, twist = 0.3 }, { bend = 0.9 }]

[outputs]
markers = 40
anchor = "base"

[cord]
name = "rubber-2mm"

[[sensors]]
name = "top"
plane = { origin = [0, 0, 8], normal = [0, 0, 1], x_axis = [1, 0, 0] }
# drawn by hand
control_points = [[2, 0], [10, 0], [75, 4.5], [140, 0], [148, 0]]
free = ["path", "plane"]

[[sensors]]
name = "side"
plane = { origin = [0, 8, 0], normal = [0, 1, 0], x_axis = [1, 0, 0] }
control_points = [[2, 0], [10, 0], [140, 0], [148, 0]]
"""


def write_device(folder):
    """Write the file and a script, which is not run, and return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "device.toml").write_text(TEXT, encoding="utf-8")
    (folder / "grip.py").write_text(
        "def body(length=150, width=30):\n    return None\n", encoding="utf-8"
    )
    return folder


def set_by_user(control, value):
    """Set a control of the page, as a browser does."""
    control.value = value
    for callback in control._impl.update_cb:
        callback(SimpleNamespace(client=object(), target=control))


def click(button):
    """Click a button of the page, as a browser does."""
    for callback in button._impl.update_cb:
        callback(None)


class InlineProcess:
    """A background job that runs in this process."""

    is_running = False

    def __init__(self, on_end):
        self._on_end = on_end

    def start(self, _run, task):
        try:
            result = task(progress=lambda *_: None)
        except DefsenseError as error:
            self._on_end(error, None)
        else:
            self._on_end(None, result)
        return True

    def cancel(self):
        pass

    close = cancel
