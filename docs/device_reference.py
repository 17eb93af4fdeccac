"""Tables of all keys of `device.toml`, made of what its reader asks for as it checks files.

`make guide` puts them where a page says ```{device-keys}```; `python docs/device_reference.py`
prints them as Markdown. What a key means is told in `defsense_fab/core/device/device_keys.py`.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from sphinx.util.docutils import SphinxDirective

from defsense_fab.core.device.catalogue import read_rows
from defsense_fab.core.device.device_file import DEVICE, read_device
from defsense_fab.core.device.device_keys import KEYS, Key
from defsense_fab.core.storage.files import write_json
from defsense_fab.core.storage.toml_table import Reading, parse_toml

_REGIONS = ("base", "tip", "middle", "side")
_POSES = ("bend", "hinge")

#: A device with every key that goes together; `variants` has the others.
WHOLE = """
schema = 1
name = "whole"
[body]
script = "body.py"
parameters = { length = 100 }
time_limit = 600
fill_cavities = false
bay = { at = [0, 0, 0], size = [14, 7, 8] }
[material]
young_modulus = 0.6
poisson_ratio = 0.49
[mesh]
edge_length = 6
[regions]
base = { box = [[0, 0, 0], [1, 1, 1]] }
tip = { sphere = { center = [0, 0, 0], radius = 1 } }
middle = { half_space = { origin = [0, 0, 0], normal = [1, 0, 0] } }
side = { cylinder = { start = [0, 0, 0], end = [1, 0, 0], radius = 1 } }
[[poses]]
name = "bend"
fixed = ["base"]
gravity = [0, 0, -1]
drags = [{ at = [0, 0, 0], by = [1, 0, 0] }]
pressures = [{ region = "side", value = 0.01 }]
symmetry = [{ region = "middle", normal = [0, 1, 0] }]
handles = [{ region = "tip", rotate = { axis = [0, 1, 0], degrees = 20, about = [0, 0, 0] } }]
[[poses]]
name = "hinge"
fixed = ["base"]
handles = [{ region = "tip", translate = [1, 0, 0] }]
[states]
ramp = [1]
mixtures = [{ bend = 1, hinge = 1 }]
held_out = [{ bend = 0.5, hinge = 0.5 }]
[outputs]
anchor = "base"
[cord]
name = "rubber-2mm"
length = [100, 400]
[readout]
[fabrication]
[design]
[[sensors]]
name = "top"
plane = { origin = [0, 0, 0], normal = [0, 0, 1], x_axis = [1, 0, 0] }
control_points = [[0, 0], [1, 0], [2, 0], [3, 0]]
tangents = [[1, 0], [1, 0], [1, 0], [1, 0]]
free = ["path"]
"""


def variants():
    """Texts of devices that together have every key, and every row of the package's tables."""

    def changed(*changes):
        text = WHOLE
        for old, new in changes:
            if old not in text:
                raise ValueError(f"{old!r} is not in the whole device")
            text = text.replace(old, new, 1)
        return text

    yield WHOLE
    script = ('script = "body.py"\nparameters = { length = 100 }', "")
    yield changed(script, ("[body]", '[body]\nstep = "body.step"'))
    yield changed(script, ("[body]", '[body]\nmesh = "body.stl"'))
    yield changed(("edge_length = 6", "accuracy = 0.01"))
    yield changed(("young_modulus = 0.6", 'shore = "30A"'))
    for model, constants in (
        ("mooney-rivlin", "c10 = 0.1\nc01 = 0.1"),
        ("yeoh", "c10 = 0.1\nc20 = 0.1\nc30 = 0.1"),
    ):
        yield changed(("young_modulus = 0.6", f'model = "{model}"\n{constants}'))
    own = ("young_modulus = 0.6\npoisson_ratio = 0.49", 'name = "{}"')
    for name in read_rows("materials.csv"):
        yield changed((own[0], own[1].format(name)))
    yield changed(("[cord]", '[cord]\nresponse = "response.json"'))
    sheet = "diameter = 2\nohm_per_mm = 15\ngauge_factor = 2\nmax_strain = 0.5"
    yield changed(('name = "rubber-2mm"', sheet))
    for name in read_rows("cords.csv"):
        yield changed(("rubber-2mm", name))
    silicone = ("young_modulus = 0.6\npoisson_ratio = 0.49", 'name = "dragon-skin-30"')
    for name, row in read_rows("printers.csv").items():
        process = ("[fabrication]", f'[fabrication]\nprocess = "{name}"')
        cast = "shrinkage = 0.001\nmould_wall = 5" if row["kind"] == "cast" else ""
        yield changed(process, ("[design]", f"{cast}\n[design]"), silicone)
    made = "bed = [220, 220, 250]\ncopies = 1\nstrain_relief = true\nprestretch = 0.1"
    yield changed(
        ("[fabrication]", f"[fabrication]\n{made}\nmarker_seats = 1"),
        ("[design]", "[design]\nsensors = 2\nplanes = 2\nseed = 1\nsearches = 5"),
    )
    yield changed(("[outputs]", "[outputs]\nmarkers = [[0, 0, 0]]"))


def readings(texts):
    """How the reader asked for the keys of these devices: {(table, key): all its readings}."""
    found = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_files(folder)
        for text in texts:
            top = parse_toml(text, folder / DEVICE)
            read_device(top, folder, {})
            for path, keys in top.asked.items():
                for key, reading in keys.items():
                    found.setdefault(_place((*path, key)), []).append(reading)
    return found


def write_files(folder):
    """What the devices name: bodies, of which the reader only sees whether they are there, and a
    response."""
    for name in ("body.py", "body.step", "body.stl"):
        (folder / name).touch()
    write_json(
        folder / "response.json",
        {"schema": 1, "model": "line", "coefficients": {"k": 2.0}, "strain_range": [0, 0.3]},
    )


def _place(path):
    """The table in which a key is explained, and the key there."""
    names = [p for p in path if isinstance(p, str)]
    if names[0] == "regions" and len(names) > 1:
        names[1] = "NAME"
    if names[0] == "states" and len(names) > 2:
        names[2] = "POSE"
    for depth in range(len(names) - 1, -1, -1):
        dotted = ".".join(names[:depth])
        for header in (f"[{dotted}]", f"[[{dotted}]]", dotted):
            if header in KEYS:
                return header, ".".join(names[depth:])
    raise ValueError(f"{path}: no table of device_keys.py holds it")


@dataclass(frozen=True)
class Explained:
    """A key with all that is known of it; `defaults` are those of all rows that may be chosen."""

    table: str
    key: str
    words: Key
    reading: Reading
    defaults: tuple[object, ...]


def explained():
    """All keys in the order of `device_keys.py`. Raises ValueError for keys that the reader asks
    for and nothing explains, that are explained and never asked for, or whose value none of the
    devices above makes it read."""
    found = readings(variants())
    told = {(table, key) for table, keys in KEYS.items() for key in keys}
    if told != set(found):
        raise ValueError(
            f"device_keys.py lacks {sorted(set(found) - told)} and has, but nothing reads,"
            f" {sorted(told - set(found))}"
        )
    out = []
    for table, keys in KEYS.items():
        for key, words in keys.items():
            all_of_it = found[table, key]
            reading = _joined(all_of_it)
            if not reading.kinds:
                raise ValueError(f"{table} {key}: no device of device_reference.py has it")
            defaults = []
            for r in all_of_it:
                if r.default is not None and r.default not in defaults:
                    defaults.append(r.default)
            out.append(Explained(table, key, words, reading, tuple(defaults)))
    return out


def _joined(all_of_it):
    """One reading, of all that were read, with the limits of them all."""
    read = [r for r in all_of_it if r.kinds]
    if not read:
        return Reading()
    kinds = tuple(dict.fromkeys(k for r in read for k in r.kinds))
    options = tuple(dict.fromkeys(o for r in read for o in r.options))
    if set(options) <= {*_REGIONS, *_POSES}:
        options = ()
    limits = max(r.within[0] for r in read), min(r.within[1] for r in read)
    everywhere = len(read) == len(all_of_it)
    return replace(
        read[0],
        kinds=kinds,
        options=options,
        within=limits,
        above=max(r.above for r in read),
        required=everywhere and all(r.required for r in read),
    )


_MOST_NAMES = 12
_KINDS = {
    "3 numbers": "`[x, y, z]`",
    "2 numbers": "two numbers",
    "2 x 3 numbers": "two of `[x, y, z]`",
    "texts": "list of texts",
    "tables": "list of tables",
    "true or false": "`true`, `false`",
}


def markdown():
    """The tables, one for each table of `device.toml`."""
    keys = explained()
    parts = []
    for table in KEYS:
        title = f"`{table}`" if table else "The file's first lines, and its tables"
        parts.append(f"### {title}\n")
        parts.append("| key | meaning | value | default |\n|---|---|---|---|")
        for one in keys:
            if one.table == table:
                cells = (f"`{one.key}`", one.words.meaning, _value(one), _default(one))
                parts.append(f"| {' | '.join(cells)} |")
        parts.append("")
    return "\n".join(parts)


def _value(one):
    """Type, unit and what is allowed."""
    allowed = _allowed(one.reading)
    if one.reading.options:
        return allowed
    kind = one.words.kind or ", ".join(_KINDS.get(k, k) for k in one.reading.kinds)
    return ", ".join(said for said in (kind, one.words.unit, allowed) if said)


def _default(one):
    if one.words.default:
        return one.words.default
    if not one.defaults:
        return "needed" if one.reading.required else ""
    if len(one.defaults) == 1:
        empty = one.defaults[0] in ({}, []) and "texts" not in one.reading.kinds
        return "none" if empty else f"`{_toml(one.defaults[0])}`"
    if all(isinstance(d, int | float) for d in one.defaults):
        return f"the row's: `{min(one.defaults):g}` to `{max(one.defaults):g}`"
    return "the row's"


def _toml(value):
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:g}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return f'"{value}"'


def _allowed(reading):
    low, high = reading.within
    said = []
    if reading.options:
        names = ", ".join(f"`{o}`" for o in reading.options)
        said.append(
            names if len(reading.options) <= _MOST_NAMES else f"{len(reading.options)} names"
        )
    if reading.above > low:
        # a limit a rounding error below zero stands for zero itself
        said.append(f"above {reading.above:g}" if abs(reading.above) != 1e-9 else "0 or more")
    elif np.isfinite(low) and not np.isfinite(high):
        said.append(f"{low:g} or more")
    elif np.isfinite(low):
        said.append(f"{low:g} to {high:g}")
    if reading.above > low and np.isfinite(high):
        said.append(f"up to {high:g}")
    return ", ".join(said)


class DeviceKeys(SphinxDirective):
    """The tables, in place of the directive."""

    def run(self):
        """Sphinx calls this."""
        room = Path(__file__).parents[1] / "defsense_fab" / "core" / "device"
        for name in ("device_keys.py", "device_file.py", "pose_file.py"):
            self.env.note_dependency(str(room / name))
        text = [markdown()]
        self.env.events.emit("source-read", self.env.docname, text)  # as of a page: links
        return self.parse_text_to_nodes(text[0], allow_section_headings=True)


if __name__ == "__main__":
    sys.stdout.reconfigure(encoding="utf-8")
    sys.stdout.write(markdown())
