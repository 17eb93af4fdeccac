"""Write one solid in many layouts of each mesh format, right and damaged.

    python -m tests.support.mesh_variants [--count 1000] [--seed 1] [formats ...]

The solids are prisms over outlines that are not convex, with corners on straight lines, in any
orientation. A file is `right` if readers must return its volume; `wrong` if they must refuse it;
and `damaged` if they may do either, but may not return another volume without a note.
"""

import argparse
import json
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from defsense_fab.core.machine.processes import peak_memory_mb
from tests.support.mesh_solids import (
    LINE_ENDS,
    Rng,
    Solid,
    broken,
    encode,
    join,
    number,
    star_prism,
)

SIZES = (1.0, 1e4)
VOLUME_TOLERANCE = 2e-3  # of the volume: coordinates are written with five digits or more


@dataclass
class Variant:
    """A file, with what is special about it, and what a reader must do with it."""

    name: str
    content: bytes
    volume: float
    kind: str = "right"


def obj(rng: Rng) -> Variant:
    solid = star_prism(rng)
    solid = solid.in_triangles(rng) if rng.random() < 0.3 else solid
    extra = int(rng.choice([0, 0, 1, 3]))
    lines = [join(["v", *(number(c, rng) for c in p), *["1.0"] * extra], rng) for p in solid.points]
    style, is_negative = int(rng.integers(4)), rng.random() < 0.3
    n = len(solid.points)
    lines += [f"vt {rng.random():.3f} 0.5", "vn 0 0 1", "s off", "g\tdeckel", "usemtl C:\\matte\\"]
    for face in solid.faces:
        corners = [str(k - n if is_negative else k + 1) for k in face]
        corners = [c + ("", "/1", "//1", "/1/1")[style] for c in corners]
        if rng.random() < 0.2:
            corners.insert(int(rng.integers(1, len(corners))), "\\\n")
        text = join(["f", *corners], rng)
        lines += [
            line + ("\\" if k == 0 and "\\\n" in text else "")
            for k, line in enumerate(text.split("\\\n"))
        ]
    fault = str(rng.choice(["", "", "", "comma", "coordinate", "junk", "index", "corner", "cut"]))
    places = [
        k
        for k, line in enumerate(lines)
        if line.strip().startswith("v") and line.strip()[1] in " \t"
    ]
    at = int(rng.choice(places))
    if fault == "comma":
        lines[at] = lines[at].replace(".", ",") if "." in lines[at] else "v 1,5 2 3"
    elif fault == "coordinate":
        lines[at] = "v 1.0 2.0"
    elif fault == "junk":
        lines.insert(
            at, str(rng.choice(["vertex 1 2 3", "1 2 3", "F 1 2 3", "v1 2 3 4", "nonsense"]))
        )
    elif fault == "index":
        lines.append(f"f 1 2 {n + 1 + int(rng.integers(9))}")
    elif fault == "corner":
        lines.append(str(rng.choice(["f 1 2", "f 1 2 x", "f 1 2 /3", "f 1 2 0", "f 1 2 3.5", "f"])))
    content = encode(lines, rng)
    return finish("obj", content, solid, fault, rng)


def finish(name: str, content: bytes, solid: Solid, fault: str, rng: Rng) -> Variant:
    if fault == "cut":
        content = content[: int(rng.integers(len(content) // 2, len(content)))]
    kind = "right" if not fault else "damaged" if fault in ("cut", "count") else "wrong"
    return Variant(f"{name} {fault or 'right'}", content, solid.volume, kind)


def off(rng: Rng) -> Variant:
    solid = star_prism(rng)
    solid = solid.in_triangles(rng) if rng.random() < 0.3 else solid
    head = str(rng.choice(["OFF", "OFF", "COFF", "NOFF", "CNOFF", "STOFF", "off"]))
    color = ["0.5"] * int(rng.choice([3, 4]))
    more = ["0.1", "0.2"] * ("ST" in head) + ["0", "0", "1"] * ("N" in head) + color * ("C" in head)
    points = [[*(number(c, rng) for c in p), *more] for p in solid.points]
    faces = [[str(len(face)), *map(str, face)] for face in solid.faces]
    fault = str(rng.choice(["", "", "", "", "comma", "index", "corner", "more", "fewer", "cut"]))
    counts = [len(points), len(faces)]
    if fault == "comma":
        points[int(rng.integers(len(points)))][1] = "1,5"
    elif fault == "index":
        faces[int(rng.integers(len(faces)))][2] = str(len(points))
    elif fault == "corner":
        faces[int(rng.integers(len(faces)))][1] = str(rng.choice(["x", "1.5", "-1"]))
    elif fault in ("more", "fewer"):
        counts[1] += 1 if fault == "more" else -1
    totals = [*map(str, counts), "0"][: int(rng.choice([2, 3]))]
    layout = str(rng.choice(["lines", "colors", "broken"])) if "C" not in head else "lines"
    if layout == "broken":
        words = [w for row in [*points, *faces] for w in row]
        lines = [f"{head} {' '.join(totals)}"] if len(totals) == 2 else [head, " ".join(totals)]
        lines += broken(words, rng) if len(totals) == 3 else [" ".join(words)]
        if len(totals) == 3 and rng.random() < 0.5:
            lines = broken([head, *totals, *words], rng)
    else:
        ends = [[], ["255", "0", "0"], ["0.5", "0.5", "0.5", "1"], ["7"]]
        end = ends[int(rng.integers(1, 4))] if layout == "colors" else []
        lines = [head, join(totals, rng), *(join(p, rng) for p in points)]
        lines += [join(face + (end if rng.random() < 0.8 else []), rng) for face in faces]
    return finish(f"off {layout}", encode(lines, rng), solid, fault, rng)


def triangles(rng: Rng) -> tuple[Solid, np.ndarray]:
    solid = star_prism(rng).in_triangles(rng)
    return solid, solid.points[np.array(solid.faces)]


def stl_text(rng: Rng) -> Variant:
    solid, corners = triangles(rng)
    name = str(rng.choice(["", "teil", "solid part", "my facet", "größe 1", "endsolid"]))
    fault = str(rng.choice(["", "", "", "comma", "junk", "fewer", "word", "cut"]))
    facets = []
    for facet in corners:
        normal = str(rng.choice(["0 0 0", "0 0 1", "nan nan nan", "-nan(ind) 0 0", "1e-3 0,5 1"]))
        rows = [f"vertex {' '.join(number(c, rng) for c in p)}" for p in facet]
        facets.append([f"facet normal {normal}", "outer loop", *rows, "endloop", "endfacet"])
    facet = facets[int(rng.integers(len(facets)))]
    if fault == "comma":
        facet[2] = "vertex 1,5 2,5 3,5"
    elif fault == "junk":
        facet.insert(
            int(rng.integers(len(facet))), str(rng.choice(["nonsense", "1.5", "vertex 1 2 3"]))
        )
    elif fault == "fewer":
        del facet[int(rng.integers(len(facet)))]
    elif fault == "word":
        facet[3] = "vertex 1.0 2.0 x"
    half = len(facets) // 2 if rng.random() < 0.2 else 0
    lines = [f"solid {name}"]
    for k, rows in enumerate(facets):
        if half and k == half:
            lines += [f"endsolid {name}", "solid second"]
        lines += [join(row.split(), rng) for row in rows]
    lines.append(str(rng.choice([f"endsolid {name}", "endsolid"])))
    if rng.random() < 0.1 and name in ("", "teil"):
        lines = [" ".join(lines)]
    if rng.random() < 0.2:
        lines = [line.upper() for line in lines]
    return finish("stl text", encode(lines, rng, ""), solid, fault, rng)


def stl_binary(rng: Rng) -> Variant:
    solid, corners = triangles(rng)
    n = len(corners)
    records = np.zeros(n, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
    records["corners"] = corners
    if rng.random() < 0.5:
        crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        records["normal"] = crosses / np.linalg.norm(crosses, axis=1)[:, None]
    if rng.random() < 0.3:
        records["attributes"] = rng.integers(0, 65536, n)
    head = [b"\0" * 80, b"solid by a program".ljust(80), b"solid facet".ljust(80, b"\0")]
    fault, count, end = str(rng.choice(["", "unset", "count", "trailing", "cut"])), n, b""
    if fault == "unset":
        count = int(rng.choice([0, 2**32 - 1]))
    elif fault == "count":
        count = max(1, n + int(rng.integers(-n, n)))
    elif fault == "trailing":
        ends = [b"\n", b"\0" * int(rng.integers(1, 500)), b"made by a program " * 9, rng.bytes(200)]
        end = ends[int(rng.integers(4))]
    content = head[int(rng.integers(3))] + np.uint32(count).tobytes() + records.tobytes() + end
    fault = "" if fault in ("unset", "trailing") else fault
    return finish("stl binary", content, solid, fault, rng)


def strips_of(faces: list[list[int]], rng: Rng) -> list[int]:
    """Return triangles as strips that -1 ends, joined where a triangle continues the one before."""
    out: list[int] = []
    for face in faces:
        if len(out) >= 3 and out[-3:].count(-1) == 0:
            tail, start = out[-2:], max((k for k, v in enumerate(out) if v == -1), default=-1) + 1
            is_odd = (len(out) - start) % 2
            edge = tail[::-1] if is_odd else tail
            for k in range(3):
                turned = face[k:] + face[:k]
                if turned[:2] == edge:
                    out.append(turned[2])
                    break
            else:
                out += [-1, *face]
        else:
            out += [-1, *face] if out else face
    return out


PLY_TYPES = {"float": "f4", "float32": "f4", "double": "f8", "float64": "f8", "uchar": "u1"}
PLY_TYPES |= {
    "uint8": "u1",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "ushort": "u2",
    "short": "i2",
}


def ply(rng: Rng) -> Variant:
    solid = star_prism(rng)
    is_strip = rng.random() < 0.2
    if is_strip or rng.random() < 0.3:
        solid = solid.in_triangles(rng)
    order = str(rng.choice(["ascii", "binary_little_endian", "binary_big_endian"]))
    mark = ">" if "big" in order else "<"
    real = str(rng.choice(["float", "double", "float32", "float64"]))
    count_type = str(
        rng.choice(["int", "uint", "int32"] if is_strip else ["uchar", "int", "uint8", "ushort"])
    )
    index_type = str(
        rng.choice(["int", "int32"] if is_strip else ["int", "uint", "ushort", "int32", "short"])
    )
    color, texture, edges = rng.random(3) < 0.4

    def cell(value: float, kind: str) -> object:
        if order == "ascii":
            return number(value, rng) if PLY_TYPES[kind][0] == "f" else str(int(value))
        return np.array(value).astype(mark + PLY_TYPES[kind]).tobytes()

    lists = [strips_of(solid.faces, rng)] if is_strip else solid.faces
    element = "tristrips" if is_strip else "face"
    name = str(rng.choice(["vertex_indices", "vertex_index"]))
    fault = str(
        rng.choice(["", "", "", "", "index", "more", "comma" if order == "ascii" else "", "cut"])
    )
    n = len(solid.points)
    if fault == "index":
        lists = [*lists[:-1], [*lists[-1][:-1], n + 3]]
    head = ["ply", f"format {order} 1.0", "comment by hand", "obj_info 1", f"element vertex {n}"]
    head += [f"property {real} {c}" for c in "xyz"] + ["property uchar red"] * bool(color)
    if edges:
        head += ["element edge 2", "property int vertex1", "property list uchar float weights"]
    head += [f"element {element} {len(lists) + (fault == 'more')}"]
    head += ["property uchar flags"] * bool(color) + [
        f"property list {count_type} {index_type} {name}"
    ]
    head += ["property list uchar float texcoord"] * bool(texture) + ["end_header"]
    rows = [
        [*(cell(c, real) for c in p), *([cell(9, "uchar")] * bool(color))] for p in solid.points
    ]
    rows += [[cell(0, "int"), cell(2, "uchar"), cell(0.5, "float"), cell(1, "float")]] * (
        2 * bool(edges)
    )
    for face in lists:
        row = [cell(1, "uchar")] * bool(color) + [cell(len(face), count_type)]
        row += [cell(k, index_type) for k in face]
        row += [cell(2, "uchar"), cell(0.1, "float"), cell(0.2, "float")] * bool(texture)
        rows.append(row)
    end = str(rng.choice(LINE_ENDS))
    content = (end.join(head) + end).encode()
    if order == "ascii":
        if fault == "comma":
            rows[int(rng.integers(n))][1] = "1,5"
        content += end.join(join(row, rng) for row in rows).encode() + end.encode()
    else:
        content += b"".join(c for row in rows for c in row)
    return finish(f"ply {element} {order}", content, solid, fault, rng)


def cells(rng: Rng) -> Variant:
    """Return tetrahedra, hexahedra, wedges, or faces in Gmsh, VTK or Medit files, with results."""
    import meshio

    suffix = str(rng.choice(["msh22", "msh", "vtu", "mesh"]))
    size = rng.uniform(5, 40, 3)
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    box = np.array([[*corner, z] for z in (0, 1) for corner in square], float)
    tets = [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]]
    sides = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    blocks = {
        "tetra": [("tetra", tets)],
        "hexahedron": [("hexahedron", [list(range(8))])],
        "wedge": [("wedge", [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]])],
        "quad": [("quad", sides)],
        "mixed": [("triangle", [[0, 3, 2], [0, 2, 1]]), ("quad", sides[1:])],
    }
    kind = str(rng.choice(list(blocks)))
    suffix = "msh22" if suffix == "msh" and kind == "mixed" else suffix
    chosen = blocks[kind] + ([("line", [[0, 1]])] if rng.random() < 0.3 and suffix != "msh" else [])
    points = box * size + rng.uniform(-5, 5, 3)
    mesh = meshio.Mesh(points, [(k, np.array(c)) for k, c in chosen])
    is_binary = bool(rng.random() < 0.3)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a.{suffix[:3] if 'msh' in suffix else suffix}"
        if "msh" in suffix:
            mesh.write(path, "gmsh22" if suffix == "msh22" else "gmsh", binary=is_binary)
        elif suffix == "vtu":
            mesh.write(path, "vtu", binary=is_binary)
        else:
            mesh.write(path, "medit")
        content = path.read_bytes()
    if "msh" in suffix and rng.random() < 0.6:
        content += b'$ElementData\n1\n"stress"\n1\n0.0\n3\n0\n1\n1\n1 2.5\n$EndElementData\n'
        content += b'$NodeData\n1\n"u"\n1\n0.0\n3\n0\n1\n1\nx\n$EndNodeData\n'
    if suffix == "vtu" and rng.random() < 0.6:
        data = b'<DataArray type="Float64" Name="s" format="ascii">1 2</DataArray>'
        results = b"<PointData>" + data + b"</PointData><CellData>" + data + b"</CellData>"
        content = content.replace(b"<Cells>", results + b"<Cells>")
    if suffix == "mesh":
        text = content.decode().replace(
            "End", "Ridges\n1\n1\nNormals\n1\n0 0 1\nRequiredVertices 1 2\nEnd"
        )
        lines = broken(text.split(), rng) if rng.random() < 0.5 else text.split("\n")
        content = encode(lines, rng)
    elif not is_binary and suffix != "vtu":
        content = content.replace(b"\n", str(rng.choice(LINE_ENDS)).encode())
    volume = float(np.prod(size))
    return finish(
        f"{suffix} {kind}",
        content,
        Solid(points, [], volume),
        str(rng.choice(["", "", "", "cut"])),
        rng,
    )


FORMATS = {
    "obj": obj,
    "off": off,
    "ply": ply,
    "stl-text": stl_text,
    "stl-binary": stl_binary,
    "cells": cells,
}


def outcome(variant: Variant, folder: Path) -> str:
    """Return what reading a variant does: `right`, `noted`, `refused`, or a `FAULT`."""
    from defsense_fab.core.errors import DefsenseError
    from defsense_fab.geometry.bodies.mesh_files import detect_format, read_mesh

    suffix = detect_format(variant.content)
    path = folder / f"a{suffix or '.stl'}"
    path.write_bytes(variant.content)
    try:
        surface, notes, _ = read_mesh(path, 1.0, SIZES)
    except DefsenseError as error:
        text = str(error)
        json.dumps(error.data)  # errors of the reading process are sent as JSON
        if "\n" in text or text.count(str(path)) != 1 or not error.action:
            return f"FAULT in the message: {text}"
        if "damaged" in text and variant.kind == "wrong":
            return f"FAULT: no reason: {text}"
        return "refused" if variant.kind != "right" else f"FAULT: refused: {error}"
    except Exception as error:
        return f"FAULT: {type(error).__name__}: {error}"
    is_right = abs(surface.volume / variant.volume - 1) < VOLUME_TOLERANCE
    if variant.kind == "wrong":
        return f"FAULT: read a wrong file: {surface.volume:.6g} of {variant.volume:.6g}, {notes}"
    if is_right:
        return "right"
    if variant.kind == "damaged" and notes:
        return "noted"
    return f"FAULT: {surface.volume:.6g} of {variant.volume:.6g} without a note, {notes}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("formats", nargs="*", default=list(FORMATS))
    options = parser.parse_args()
    for name in options.formats:
        results: Counter[str] = Counter()
        longest = 0.0
        for k in range(options.count):
            variant = FORMATS[name](np.random.default_rng([options.seed, k]))
            with tempfile.TemporaryDirectory() as folder:
                started_at = time.process_time()
                result = outcome(variant, Path(folder))
                longest = max(longest, time.process_time() - started_at)
            results[result.split(":")[0]] += 1
            if result.startswith("FAULT"):
                print(f"{name} {k} ({variant.name}): {result}", flush=True)
        peak_mb = peak_memory_mb()
        print(f"{name}: {dict(results)}, at most {longest:.2f} s, {peak_mb:.0f} MB", flush=True)


if __name__ == "__main__":
    main()
