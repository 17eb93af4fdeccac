"""Rectangles on plates: none over another, and few plates."""

import numpy as np
import pytest

from defsense_fab.geometry.printing.packing import count_least_plates, pack


def placed(sizes, places):
    out = []
    for name, place in places.items():
        w, d = sizes[name][::-1] if place.turned else sizes[name]
        out.append((place.plate, place.x, place.y, place.x + w, place.y + d))
    return out


@pytest.mark.parametrize("seed", range(6))
def test_no_two_overlap_and_all_lie_on_their_plate(seed):
    rng = np.random.default_rng(seed)
    sizes = {f"r{k}": tuple(rng.uniform(8, 130, 2).tolist()) for k in range(30)}
    boxes = placed(sizes, pack(sizes, (210.0, 190.0)))
    assert len(boxes) == 30
    for k, (plate, x0, y0, x1, y1) in enumerate(boxes):
        assert -1e-9 <= x0 < x1 <= 210 + 1e-9
        assert -1e-9 <= y0 < y1 <= 190 + 1e-9
        for other, a0, b0, a1, b1 in boxes[:k]:
            apart = x1 <= a0 + 1e-6 or a1 <= x0 + 1e-6 or y1 <= b0 + 1e-6 or b1 <= y0 + 1e-6
            assert other != plate or apart
    used = 1 + max(b[0] for b in boxes)
    assert (
        count_least_plates(sizes, (210.0, 190.0))
        <= used
        <= count_least_plates(sizes, (210.0, 190.0)) + 1
    )


def test_pieces_of_a_divided_plate_fill_one_plate():
    """Plates cut up by guillotine: the areas' bound is reached, or missed by one plate in all."""
    rng = np.random.default_rng(1)
    more = 0
    for _ in range(20):
        whole = [(0.0, 0.0, 200.0, 200.0)]
        for _ in range(7):
            k = int(np.argmax([w * d for _, _, w, d in whole]))
            x, y, w, d = whole.pop(k)
            cut = rng.uniform(0.3, 0.7)
            whole += (
                [(x, y, w * cut, d), (x + w * cut, y, w * (1 - cut), d)]
                if w > d
                else [(x, y, w, d * cut), (x, y + d * cut, w, d * (1 - cut))]
            )
        sizes = {str(k): (w, d) for k, (_, _, w, d) in enumerate(whole)}
        assert count_least_plates(sizes, (200.0, 200.0)) == 1
        plates = 1 + max(p.plate for p in pack(sizes, (200.0, 200.0)).values())
        assert plates <= 2
        more += plates - 1
    assert more < 20
    thirds = {str(k): (66.0, 99.0) for k in range(12)}
    assert 1 + max(p.plate for p in pack(thirds, (200.0, 200.0)).values()) == 2


def test_lower_bound_counts_rectangles_that_exclude_each_other():
    bed = (200.0, 160.0)
    for size in ((120.0, 110.0), (110.0, 120.0), (150.0, 130.0), (190.0, 81.0)):
        wide = {str(k): size for k in range(5)}
        used = 1 + max(p.plate for p in pack(wide, bed).values())
        assert count_least_plates(wide, bed) == used == 5
    for size in ((100.0, 160.0), (200.0, 80.0), (80.0, 150.0)):  # two of a plate
        halves = {str(k): size for k in range(4)}
        used = 1 + max(p.plate for p in pack(halves, bed).values())
        assert count_least_plates(halves, bed) == used == 2
    assert count_least_plates({}, bed) == 0
