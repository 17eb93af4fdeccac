"""Mesh files in any layout are read right, and wrong ones are refused with a reason.

`DEFSENSE_VARIANTS` is the number of files of each format, such as 1000.
"""

import os

import numpy as np
import pytest

from tests.support.mesh_variants import FORMATS, outcome

COUNT = int(os.environ.get("DEFSENSE_VARIANTS", "40"))


@pytest.mark.parametrize("name", FORMATS)
def test_no_variant_is_read_wrong_or_refused_without_reason(name, tmp_path):
    outcomes = {}
    for k in range(COUNT):
        variant = FORMATS[name](np.random.default_rng([1, k]))
        outcomes[k, variant.name] = outcome(variant, tmp_path)
    faults = {key: text for key, text in outcomes.items() if text.startswith("FAULT")}
    assert not faults
    assert "right" in outcomes.values()
    assert "refused" in outcomes.values()
