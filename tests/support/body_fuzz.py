"""Damaged files of bodies, and what the command and the studio say to them.

`python -m tests.support.body_fuzz [--count 200] [--seed 1] [--limit 60]`: each file is taken through
the build's first stage, and every third through what the studio does with a file that is dropped on
it. Whatever is not a body in one piece, or a message of one line, is a fault: a traceback, a
hang, memory beyond the bound, files left behind, a surface that is not closed. Readers that crash
in their own process, which is told in a line, are counted apart.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import resource
import struct
import tempfile
import time
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

Rng = np.random.Generator
Mutation = Callable[[bytes, str, Rng], bytes]
_TEXT = (".step", ".obj", ".off", ".mesh", ".gltf")


def originals() -> dict[str, bytes]:
    """A sound file of each kind, by suffix; binary and text where a format has both."""
    import meshio
    import trimesh

    from defsense_fab.core.mesh import Surface
    from defsense_fab.geometry.kernels import occ
    from defsense_fab.geometry.printing.export import write_3mf

    from .defective_bodies import creature

    v, f = creature(2)
    mesh = trimesh.Trimesh(v, f, process=False)
    small = trimesh.Trimesh(v * 1e-3, f, process=False)
    points = np.concatenate([v, [[0.0, 0, 0]]])
    tets = np.column_stack([f, np.full(len(f), len(v))])
    found = {
        ".stl": mesh.export(file_type="stl"),
        " ascii.stl": mesh.export(file_type="stl_ascii").encode(),
        ".obj": mesh.export(file_type="obj").encode(),
        ".ply": mesh.export(file_type="ply"),
        " ascii.ply": mesh.export(file_type="ply", encoding="ascii"),
        ".off": mesh.export(file_type="off").encode(),
        ".glb": trimesh.Scene(small).export(file_type="glb"),
    }
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(small), embed_buffers=True)
    found[".gltf"] = next(c for n, c in files.items() if n.endswith(".gltf"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_3mf({"a": Surface(v, f)}, folder / "a.3mf", "a")
        for suffix, kind in ((".msh", "gmsh"), (".vtu", "vtu"), (".mesh", "medit")):
            meshio.write(folder / f"a{suffix}", meshio.Mesh(points, [("tetra", tets)]), kind)
        import build123d as bd

        part = bd.fillet(bd.Box(60, 30, 20).edges().filter_by(bd.Axis.Z), 4) - bd.Cylinder(5, 20)
        occ.write_step(part.solids()[0].wrapped, folder / "a.step", "a")
        found |= {p.suffix: p.read_bytes() for p in folder.iterdir()}
    return found


def flipped(data: bytes, suffix: str, rng: Rng) -> bytes:
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 40))):
        out[rng.integers(len(out))] = rng.integers(256)
    return bytes(out)


def truncated(data: bytes, suffix: str, rng: Rng) -> bytes:
    return data[: int(rng.integers(len(data)))]


def doubled(data: bytes, suffix: str, rng: Rng) -> bytes:
    """A piece of it once more, somewhere else."""
    a, b = sorted(rng.integers(len(data), size=2))
    at = int(rng.integers(len(data)))
    return data[:at] + data[a:b] + data[at:]


def counted(data: bytes, suffix: str, rng: Rng) -> bytes:
    """A number in it, or four bytes, claim billions."""
    if suffix == ".stl" and not data.startswith(b"solid"):
        return data[:80] + struct.pack("<I", 2**32 - 1 - int(rng.integers(99))) + data[84:]
    return _numbers(data, rng, [b"4294967295", b"2000000000", b"99999999999999", b"-1"])


def indexed(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Indices that nothing has."""
    return _numbers(data, rng, [b"123456789", b"-7", b"1e9", b"99999"])


def unreal(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Numbers that are none."""
    return _numbers(data, rng, [b"nan", b"inf", b"-inf", b"1e308", b"1e-320", b"--", b""])


def _numbers(data: bytes, rng: Rng, put: list[bytes]) -> bytes:
    import re

    if suffix_is_binary(data):
        out = bytearray(data)
        for _ in range(3):
            at = int(rng.integers(max(1, len(out) - 4)))
            out[at : at + 4] = [b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff", b"\0\0\x80\x7f",
                                b"\0\0\xc0\x7f"][int(rng.integers(4))]  # fmt: skip
        return bytes(out)
    found = list(re.finditer(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?", data))
    for match in sorted(rng.choice(len(found), 3), reverse=True):
        m = found[match]
        data = data[: m.start()] + put[int(rng.integers(len(put)))] + data[m.end() :]
    return data


def suffix_is_binary(data: bytes) -> bool:
    return b"\0" in data[:4096]


def nested(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Brackets a hundred thousand deep, where brackets belong."""
    deep = 100_000
    if suffix == ".gltf":
        return b'{"asset": {"version": "2.0"}, "meshes": ' + b"[" * deep + b"]" * deep + b"}"
    if suffix == ".glb":
        text = b'{"asset":{"version":"2.0"},"meshes":' + b"[" * deep + b"]" * deep + b"}"
        text += b" " * (-len(text) % 4)
        return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text
    if suffix == ".vtu":
        return data.replace(b"<UnstructuredGrid>", b"<UnstructuredGrid>" + b"<a>" * deep)
    if suffix == ".3mf":
        return zipped(
            data, lambda text: text.replace(b"<resources>", b"<resources>" + b"<a>" * deep)
        )
    if suffix == ".step":
        return data.replace(b"DATA;", b"DATA;\n#9999=CARTESIAN_POINT(" + b"(" * deep + b")" * deep
                            + b");")  # fmt: skip
    return data[:100] + b"(" * deep + data[100:]


def looped(data: bytes, suffix: str, rng: Rng) -> bytes:
    """References that go in circles, and swapped ones."""
    if suffix == ".step":
        import re

        names = [int(m[1]) for m in re.finditer(rb"^#(\d+) *=", data, re.MULTILINE)]
        for _ in range(5):
            a, b = (b"#%d" % n for n in rng.choice(names, 2))
            data = data.replace(a + b",", b + b",").replace(a + b")", b + b")")
        return data
    if suffix == ".gltf":
        tree = json.loads(data)
        tree["nodes"] = [{"children": [1], "mesh": 0}, {"children": [0], "mesh": 0}]
        return json.dumps(tree).encode()
    lines = data.split(b"\n")
    rng.shuffle(lines)
    return b"\n".join(lines)


def zipped(data: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """A 3MF file whose model is changed."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w", 8) as new:
        for name in old.namelist():
            text = old.read(name)
            new.writestr(name, change(text) if name.endswith(".model") else text)
    return out.getvalue()


def bomb(data: bytes, suffix: str, rng: Rng) -> bytes:
    """A little that becomes a lot."""
    if suffix == ".3mf":
        return zipped(data, lambda text: text.replace(b"<vertices>", b"<vertices>" + b" " * 2**29))
    if suffix == ".vtu":
        head = b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "' + b"c" * 1000 + b'">'
        for k in range(8):
            head += b'<!ENTITY %c "%s">' % (100 + k, b"&%c;" % (98 if k == 0 else 99 + k) * 10)
        return head + b']><VTKFile type="UnstructuredGrid">&k;</VTKFile>'
    return data + data[-200:] * 2000


def emptied(data: bytes, suffix: str, rng: Rng) -> bytes:
    return [b"", data[:4], data[:80], b"\0" * 84, b"solid x\nendsolid x\n", data[:200]][
        int(rng.integers(6))
    ]


MUTATIONS: tuple[Mutation, ...] = (
    flipped, truncated, doubled, counted, indexed, unreal, nested, looped, bomb, emptied,
)  # fmt: skip


def mutated(count: int, seed: int) -> list[tuple[str, bytes]]:
    """Names that tell what was done, with a suffix, wrong in every ninth, and contents."""
    sound, rng = originals(), np.random.default_rng(seed)
    kinds, out = sorted(sound), []
    for k in range(count):
        kind = kinds[k % len(kinds)]
        change = MUTATIONS[(k // len(kinds)) % len(MUTATIONS)]
        suffix = f".{kind.rpartition('.')[2]}"
        content = change(sound[kind], suffix, rng)
        if k % 9 == 8:
            suffix = f".{kinds[int(rng.integers(len(kinds)))].rpartition('.')[2]}"
        out.append((f"{k:03d} {change.__name__} {kind.strip()}{suffix}", content))
    return out


DEVICE = """schema = 1
name = "fuzz"
[body]
{kind} = "{name}"
time_limit = {limit}
[material]
name = "tango-plus"
[mesh]
edge_length = 5
[outputs]
markers = 10
[cord]
name = "rubber-2mm"
[fabrication]
process = "fdm-tpu"
"""


def built(name: str, content: bytes, folder: Path, limit: float) -> str:
    """What the build's first stage makes of a file: `ok`, or what it says; raises AssertionError
    where something is left behind, or what is made is no closed surface."""
    from defsense_fab.core.device.device_file import load_device
    from defsense_fab.core.errors import DefsenseError
    from defsense_fab.store.body import load_surface
    from defsense_fab.workflow.build import stage_body

    (folder / name).write_bytes(content)
    kind = "step" if name.endswith(".step") else "mesh"
    (folder / "device.toml").write_text(DEVICE.format(kind=kind, name=name, limit=limit))
    build = folder / "build"
    build.mkdir()
    try:
        stage_body.run(load_device(folder, complete=False), build, lambda *_: None)
    except DefsenseError as error:
        said = str(error)
    else:
        said = ""
    if said:
        assert not list(build.iterdir()), "something half-written"
        return _line(said)
    surface = load_surface(build)
    edges = np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    assert (counts == 2).all(), "an open surface"
    assert surface.volume > 0, "inside out"
    return "ok"


def dropped(name: str, content: bytes) -> str:
    """What the studio makes of a file."""
    from defsense_fab.core.errors import DefsenseError
    from defsense_fab.workflow.starts.dropped_body import look_at_file

    try:
        look_at_file(name, content)
    except DefsenseError as error:
        return _line(str(error))
    return "ok"


def _line(said: str) -> str:
    if "\n" in said or "Traceback" in said:
        raise AssertionError(f"more than one line: {said}")
    return said


def outcome(said: str) -> str:
    """What a message is: `ok`, `refused`, `crash told`, or `fault`."""
    if said == "ok":
        return said
    if said.startswith("FAULT") or "did not end within" in said:
        return "fault"
    return "crash told" if "ended early" in said else "refused"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit", type=float, default=60.0, help="CPU is shared: s of waiting")
    options = parser.parse_args()
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as scratch:
        os.environ["TMPDIR"] = tempfile.tempdir = scratch
        for k, (name, content) in enumerate(mutated(options.count, options.seed)):
            if k < options.first:
                continue
            begun, said = time.monotonic(), []
            try:
                with tempfile.TemporaryDirectory() as folder:
                    said.append(built(name, content, Path(folder), options.limit))
                if k % 3 == 0:
                    said.append(dropped(name, content))
                assert not os.listdir(scratch), "files left behind"
            except Exception:
                said.append("FAULT " + traceback.format_exc().strip().replace("\n", " | ")[-600:])
            seconds = time.monotonic() - begun
            for line in said:
                outcomes[outcome(line)] += 1
                print(f"{name} ({len(content)} B, {seconds:.1f} s): {outcome(line)}:"
                      f" {line[-260:]}", flush=True)  # fmt: skip
    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    print(f"{dict(outcomes)}; the largest process {most:.2f} GB")


if __name__ == "__main__":
    main()
