"""Damage files of bodies and check how the build and the studio handle them.

    python -m tests.support.body_fuzz [--count 200] [--seed 1] [--limit 60]

Each file passes the first stage of the build; every third is also dropped on the studio. Allowed
are a body in one piece, and a message of one line. Faults are tracebacks, hangs, memory beyond the
limit, files that are not removed, and open surfaces. Readers that crash in their own process, with
a message of one line, are counted separately.
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
    """Return a valid file of each kind, by suffix; binary and text if a format has both."""
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
    contents = {
        ".stl": mesh.export(file_type="stl"),
        " ascii.stl": mesh.export(file_type="stl_ascii").encode(),
        ".obj": mesh.export(file_type="obj").encode(),
        ".ply": mesh.export(file_type="ply"),
        " ascii.ply": mesh.export(file_type="ply", encoding="ascii"),
        ".off": mesh.export(file_type="off").encode(),
        ".glb": trimesh.Scene(small).export(file_type="glb"),
    }
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(small), embed_buffers=True)
    contents[".gltf"] = next(c for n, c in files.items() if n.endswith(".gltf"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_3mf({"a": Surface(v, f)}, folder / "a.3mf", "a")
        for suffix, kind in ((".msh", "gmsh"), (".vtu", "vtu"), (".mesh", "medit")):
            meshio.write(folder / f"a{suffix}", meshio.Mesh(points, [("tetra", tets)]), kind)
        import build123d as bd

        part = bd.fillet(bd.Box(60, 30, 20).edges().filter_by(bd.Axis.Z), 4) - bd.Cylinder(5, 20)
        occ.write_step(part.solids()[0].wrapped, folder / "a.step", "a")
        contents |= {p.suffix: p.read_bytes() for p in folder.iterdir()}
    return contents


def flipped(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Change random bytes."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 40))):
        out[rng.integers(len(out))] = rng.integers(256)
    return bytes(out)


def truncated(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Cut the file off."""
    return data[: int(rng.integers(len(data)))]


def doubled(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Repeat a piece of the file at another place."""
    a, b = sorted(rng.integers(len(data), size=2))
    at = int(rng.integers(len(data)))
    return data[:at] + data[a:b] + data[at:]


def counted(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Make a number, or four bytes, claim billions."""
    if suffix == ".stl" and not data.startswith(b"solid"):
        return data[:80] + struct.pack("<I", 2**32 - 1 - int(rng.integers(99))) + data[84:]
    return _numbers(data, rng, [b"4294967295", b"2000000000", b"99999999999999", b"-1"])


def indexed(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Insert indices that do not exist."""
    return _numbers(data, rng, [b"123456789", b"-7", b"1e9", b"99999"])


def unreal(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Insert invalid numbers."""
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
    contents = list(re.finditer(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?", data))
    for match in sorted(rng.choice(len(contents), 3), reverse=True):
        m = contents[match]
        data = data[: m.start()] + put[int(rng.integers(len(put)))] + data[m.end() :]
    return data


def suffix_is_binary(data: bytes) -> bool:
    return b"\0" in data[:4096]


def nested(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Nest brackets 100,000 deep, where brackets are allowed."""
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
    """Insert circular references, or exchange references."""
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
    """Return a 3MF file with a changed model."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w", 8) as new:
        for name in old.namelist():
            text = old.read(name)
            new.writestr(name, change(text) if name.endswith(".model") else text)
    return out.getvalue()


def bomb(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Insert content that expands to a huge size."""
    if suffix == ".3mf":
        return zipped(data, lambda text: text.replace(b"<vertices>", b"<vertices>" + b" " * 2**29))
    if suffix == ".vtu":
        head = b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "' + b"c" * 1000 + b'">'
        for k in range(8):
            head += b'<!ENTITY %c "%s">' % (100 + k, b"&%c;" % (98 if k == 0 else 99 + k) * 10)
        return head + b']><VTKFile type="UnstructuredGrid">&k;</VTKFile>'
    return data + data[-200:] * 2000


def emptied(data: bytes, suffix: str, rng: Rng) -> bytes:
    """Keep nothing, or the first bytes."""
    return [b"", data[:4], data[:80], b"\0" * 84, b"solid x\nendsolid x\n", data[:200]][
        int(rng.integers(6))
    ]


MUTATIONS: tuple[Mutation, ...] = (
    flipped, truncated, doubled, counted, indexed, unreal, nested, looped, bomb, emptied,
)  # fmt: skip


def mutated(count: int, seed: int) -> list[tuple[str, bytes]]:
    """Return names and contents of damaged files; every ninth has a wrong suffix."""
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
name = "ninjaflex-85a"
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
    """Return the result of the first stage of the build: `ok`, or the message.

    Raises:
        AssertionError: Files remain, or the resulting surface is not closed.
    """
    from defsense_fab.core.device.device_file import load_device
    from defsense_fab.core.errors import DefsenseError
    from defsense_fab.store.body import load_surface
    from defsense_fab.store.build import Build
    from defsense_fab.workflow.build import stage_body

    (folder / name).write_bytes(content)
    kind = "step" if name.endswith(".step") else "mesh"
    (folder / "device.toml").write_text(DEVICE.format(kind=kind, name=name, limit=limit))
    build = folder / "build"
    build.mkdir()
    try:
        stage_body.run(load_device(folder, complete=False), Build(build), lambda *_: None)
    except DefsenseError as error:
        messages = str(error)
    else:
        messages = ""
    if messages:
        assert not list(build.iterdir()), "something half-written"
        return _line(messages)
    surface = load_surface(build)
    edges = np.sort(surface.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    assert (counts == 2).all(), "an open surface"
    assert surface.volume > 0, "inside out"
    return "ok"


def dropped(name: str, content: bytes) -> str:
    """Return the result of dropping the file on the studio: `ok`, or the message."""
    from defsense_fab.core.errors import DefsenseError
    from defsense_fab.workflow.starts.body_file import load_body_content

    try:
        load_body_content(name, content)
    except DefsenseError as error:
        return _line(str(error))
    return "ok"


def _line(messages: str) -> str:
    if "\n" in messages or "Traceback" in messages:
        raise AssertionError(f"more than one line: {messages}")
    return messages


def outcome(messages: str) -> str:
    """Return the kind of a message: `ok`, `refused`, `crash reported`, or `fault`."""
    if messages == "ok":
        return messages
    if messages.startswith("FAULT") or "did not end within" in messages:
        return "fault"
    return "crash reported" if "ended early" in messages else "refused"


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
            started_at, messages = time.monotonic(), []
            try:
                with tempfile.TemporaryDirectory() as folder:
                    messages.append(built(name, content, Path(folder), options.limit))
                if k % 3 == 0:
                    messages.append(dropped(name, content))
                assert not os.listdir(scratch), "files left behind"
            except Exception:
                messages.append(
                    "FAULT " + traceback.format_exc().strip().replace("\n", " | ")[-600:]
                )
            seconds = time.monotonic() - started_at
            for line in messages:
                outcomes[outcome(line)] += 1
                print(f"{name} ({len(content)} B, {seconds:.1f} s): {outcome(line)}:"
                      f" {line[-260:]}", flush=True)  # fmt: skip
    peak_gb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    print(f"{dict(outcomes)}; the largest process {peak_gb:.2f} GB")


if __name__ == "__main__":
    main()
