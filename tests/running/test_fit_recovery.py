"""Bodies that lock, pressed and dragged with friction: E, M and mu from noisy curves.

The noise is 1 % of the largest value of a curve.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from contact_locking import from_mapping
from contact_locking.inverse.fit.curves import read_experiments
from contact_locking.inverse.fit.model import Model
from contact_locking.inverse.fit.session import Search
from contact_locking.inverse.fit.starts import variables_of
from contact_locking.inverse.sensitivities import value_of
from contact_locking.monitor import Monitor
from contact_locking.running.solving import solve_steps
from contact_locking.study_file.parameters import Parameters

# Each fit takes half a minute and more.
pytestmark = [pytest.mark.serial, pytest.mark.slow]

NOISE = 0.01
YOUNG, LIMIT, MU = "material.elasticity.young", "material.locking_limit", "parameters.mu"
PAD: dict[str, Any] = {
    "parameters": {"mu": 0.3},
    "mesh": {"builder": "block", "size": [1.0, 0.4], "h": 0.1},
    "discretisation": {"degree": 2},
    "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.1},
    "loads": {"displacements": [{"on": "bottom", "value": [0, 0]}]},
    "contact": {
        "on": "top",
        "foundation": {
            "cylinder": {"centre": [0.5, 1.9], "radius": 1.5},
            "motion": ["0.06*max(t-0.5, 0)", "-0.034*min(2*t, 1)"],
        },
    },
    "friction": {"coefficient": "mu", "smoothing": {"kernel": "none"}},
    "penalty": {"n": math.inf},
    "steps": {"times": [0.15, 0.3, 0.4, 0.5, 0.6, 0.75, 1.0]},
}


def search(
    study: dict[str, Any], made: Parameters, numbers: dict[str, Any], folder: Path, seed: int = 0
) -> Search:
    """The search for numbers in noisy reactions that other parameters have made."""
    part, has_errors = ("bottom", True) if study["contact"]["on"] == "top" else ("top", False)
    quantities = {"press": f"reactions.{part}.1", "drag": f"reactions.{part}.0"}
    steps = solve_steps(made)
    rows = np.array([[s.time, *(value_of(name, s) for name in quantities.values())] for s in steps])
    spread = NOISE * np.abs(rows[:, 1:]).max(axis=0)
    rows[:, 1:] += spread * np.random.default_rng(seed).standard_normal(rows[:, 1:].shape)
    names = ["t", *quantities]
    if has_errors:
        rows = np.hstack([rows, np.tile(spread, (len(rows), 1))])
        names += [f"sigma_{name}" for name in quantities]
    curve = folder / f"{seed}.csv"
    np.savetxt(curve, rows, delimiter=",", header=",".join(names), comments="")
    given = {"data": str(curve), "quantities": quantities, "parameters": numbers}
    asked = from_mapping(study | {"fit": given})
    model = Model(asked, read_experiments(asked), (folder,), MPI.COMM_WORLD)
    return Search(model, variables_of(asked), Monitor())


def finer(**changes: Any) -> Parameters:
    return from_mapping(PAD | changes | {"mesh": PAD["mesh"] | {"h": 0.0625}})


def test_a_pad_has_its_numbers_within_two_errors(tmp_path: Path) -> None:
    # Of the first step the limit is above all strains, of some trials below what contact admits.
    start = {YOUNG: 1.5, LIMIT: 0.095, MU: 0.2}
    numbers = {key: {"start": value, "bounds": [0.01, 10]} for key, value in start.items()}
    one = search(PAD, finer(), numbers, tmp_path)
    found = one.run()
    assert found.converged and one.evaluations <= 30
    assert np.all(np.abs(found.numbers - [1.0, 0.1, 0.3]) <= 2.0 * found.errors)
