"""Solids of polygons, and ways to write text, for variants of mesh files."""

from dataclasses import dataclass, field

import numpy as np

Rng = np.random.Generator
LINE_ENDS = ("\n", "\r\n", "\r")


@dataclass
class Solid:
    """A closed surface of polygons, outward, with its volume."""

    points: np.ndarray
    faces: list[list[int]]
    volume: float

    def in_triangles(self, rng: Rng) -> "Solid":
        """Divide the faces by trusted means: sides by a diagonal, caps around their center."""
        points, faces = list(self.points), []
        for face in self.faces:
            if len(face) == 4:
                faces += [[face[0], face[1], face[2]], [face[0], face[2], face[3]]]
                continue
            center = len(points)
            points.append(np.round(self.centers[face[0]], 5))
            faces += [[a, b, center] for a, b in zip(face, face[1:] + face[:1], strict=True)]
        return Solid(np.array(points), faces, self.volume)

    centers: dict[int, np.ndarray] = field(default_factory=dict)


def star_prism(rng: Rng) -> Solid:
    """Return a prism over an outline that its center sees whole, with corners on its sides."""
    n = int(rng.integers(4, 12))
    angles = 2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n
    radii = rng.uniform(8, 30, n)
    outline = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
    for k in sorted(rng.choice(n, int(rng.integers(0, 3)), replace=False), reverse=True):
        between = outline[k] + rng.uniform(0.3, 0.7) * (outline[(k + 1) % n] - outline[k])
        if not any(np.allclose(between, p, atol=0.5) for p in outline):
            outline = np.insert(outline, k + 1, between, axis=0)
    n, height = len(outline), rng.uniform(5, 40)
    x, y = outline.T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    points = np.concatenate([np.c_[outline, np.zeros(n)], np.c_[outline, np.full(n, height)]])
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    if rng.random() < 0.5:
        turn = np.eye(3)
    shift = rng.uniform(-20, 20, 3)
    bottom, top = (
        np.roll(np.arange(n)[::-1], rng.integers(n)),
        np.roll(np.arange(n, 2 * n), rng.integers(n)),
    )
    faces = [bottom.tolist(), top.tolist()]
    faces += [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
    faces = [np.roll(face, rng.integers(len(face))).tolist() for face in faces]
    rng.shuffle(faces)
    centers = {k: shift + turn @ [0, 0, height * (k >= n)] for k in range(2 * n)}
    # All formats of numbers keep five decimals, so that corners of neighbors agree.
    return Solid(np.round(points @ turn.T + shift, 5), faces, area * height, centers)


def number(value: float, rng: Rng) -> str:
    formats = ("{:.6f}", "{:.7g}", "{:+.6f}", "{:.8e}", "{:.8E}", "{!r}")
    return str(rng.choice(formats)).format(float(value))


def space(rng: Rng) -> str:
    return str(rng.choice([" ", "\t", "  ", " \t ", "\t\t"]))


def join(words: list[str], rng: Rng) -> str:
    out = str(rng.choice(["", "", " ", "\t"]))
    for word in words:
        out += word + space(rng)
    return out.rstrip() + str(rng.choice(["", "", " "]))


def encode(lines: list[str], rng: Rng, comment: str = "#") -> bytes:
    """Return lines as bytes with any line ends and encoding, comments and blank lines."""
    out = []
    for line in lines:
        is_continued = bool(out) and out[-1].endswith("\\")
        if comment and rng.random() < 0.05 and not is_continued:
            out.append(str(rng.choice(["", comment + " größe 1 2 3", comment, "   "])))
        if comment and rng.random() < 0.05 and "\\" not in line:
            line += " " + comment + " 1 2 3"
        out.append(line)
    text = str(rng.choice(LINE_ENDS)).join(out) + str(rng.choice(["\n", ""]))
    return text.encode(str(rng.choice(["utf-8", "utf-8", "utf-8-sig", "utf-16", "latin-1"])))


def broken(words: list[str], rng: Rng) -> list[str]:
    """Break words into lines anywhere."""
    if rng.random() < 0.2:
        return [" ".join(words)]
    lines, at = [], 0
    while at < len(words):
        step = int(rng.integers(1, 12))
        lines.append(join(words[at : at + step], rng))
        at += step
    return lines
