"""The model case on a regular grid, with a proved bound of its error."""

from __future__ import annotations

import math
from typing import Any

from problems import block

from contact_locking.study_file.parameters import Parameters


def benchmark(divisions: int, **changes: Any) -> Parameters:
    """The model case on the regular grid with the larger error, with a proved bound."""
    loads = {
        "tractions": [{"on": "top", "value": [-0.03, -0.05]}],
        "displacements": [{"on": "right", "value": [0.0, 0.0]}],
    }
    changes = {"penalty__n": math.inf, "material__locking_limit": 0.05, "loads": loads} | changes
    return block(
        2, 1.0 / divisions, mesh__structured=True, certificate__error_bound=True, **changes
    )
