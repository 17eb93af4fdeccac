"""Draw the picture of a cluster.

python docs/cluster/make_pictures.py
"""

from pathlib import Path

HERE = Path(__file__).parent
INK, SOFT, BODY, EDGE = "#1b262c", "#52616b", "#dfe6ea", "#8fa3b0"
WIDTH, HEIGHT = 690, 230


def box(x, y, title, words):
    """Return a box of 190 x 60 pixels with a title and a line below it."""
    return (
        f'<rect x="{x}" y="{y}" width="190" height="60" rx="6" fill="{BODY}" stroke="{EDGE}"/>'
        f'<text x="{x + 95}" y="{y + 26}" text-anchor="middle" font-weight="bold">{title}</text>'
        f'<text x="{x + 95}" y="{y + 46}" text-anchor="middle" fill="{SOFT}" font-size="12">{words}'
        "</text>"
    )


def arrow(x1, y1, x2, y2):
    """Return an arrow with two tips."""
    return (
        f'<path d="M{x1},{y1} L{x2},{y2}" stroke="{SOFT}" stroke-width="2" marker-end="url(#tip)"'
        ' marker-start="url(#tip)"/>'
    )


def main():
    """Write `cluster.svg`."""
    workers = "".join(
        box(490, y, "dask worker", f"machine {k}") + arrow(424, 115, 484, y + 30)
        for k, y in ((1, 10), (2, 85), (3, 160))
    )
    content = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}"'
        f' height="{HEIGHT}" font-family="DejaVu Sans, Arial, sans-serif" font-size="15"'
        f' fill="{INK}"><rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>'
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6"'
        f' markerHeight="6" orient="auto-start-reverse"><path d="M0,0 L8,4 L0,8 z" fill="{SOFT}"/>'
        "</marker></defs>"
        + box(10, 85, "defsense study", "your machine: log and results")
        + arrow(206, 115, 228, 115)
        + box(234, 85, "dask scheduler", "passes runs to workers")
        + workers
        + "</svg>\n"
    )
    (HERE / "cluster.svg").write_text(content, encoding="utf-8")


if __name__ == "__main__":
    main()
