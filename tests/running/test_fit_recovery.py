"""A pad that locks, pressed and dragged with friction: E, M and mu from noisy curves.

The curves are made on a finer mesh than that of the fit, with noise of 1 % of their largest value.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from contact_locking import from_mapping
from contact_locking.arrays import FloatArray
from contact_locking.inverse.fit.curves import read_experiments
from contact_locking.inverse.fit.model import Model
from contact_locking.inverse.fit.session import Search
from contact_locking.inverse.fit.starts import variables_of
from contact_locking.inverse.sensitivities import value_of
from contact_locking.monitor import Monitor
from contact_locking.process.solving import solve_steps

# Each fit takes half a minute and more.
pytestmark = [pytest.mark.serial, pytest.mark.slow]

TRUTH = {"material.elasticity.young": 1.0, "material.locking_limit": 0.1, "parameters.mu": 0.3}
START = {"material.elasticity.young": 1.5, "material.locking_limit": 0.095, "parameters.mu": 0.2}
# Of the first step the limit is above all strains, and of some trials below what contact admits.
NOISE, MOST_EVALUATIONS = 0.01, 12
QUANTITIES = {"press": "reactions.bottom.1", "drag": "reactions.bottom.0"}
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


# So deep that the limit makes a third of the force.
DEEPER: dict[str, Any] = {
    "on": "top",
    "foundation": PAD["contact"]["foundation"]
    | {"motion": ["0.06*max(t-0.5, 0)", "-0.036*min(2*t, 1)"]},
}


@pytest.fixture(scope="module")
def clean() -> FloatArray:
    """The curves of the pad."""
    return curves()


def curves(**changes: Any) -> FloatArray:
    """Rows of time, press and drag on the finer mesh."""
    fine = from_mapping(PAD | changes | {"mesh": PAD["mesh"] | {"h": 0.0625}})
    rows = [
        [solution.time, *(value_of(name, solution) for name in QUANTITIES.values())]
        for solution in solve_steps(fine)
    ]
    return np.array(rows)


def search(clean: FloatArray, seed: int, keys: list[str], folder: Path, **changes: Any) -> Search:
    """The search for numbers in noisy data."""
    rows, random = clean.copy(), np.random.default_rng(seed)
    spread = NOISE * np.abs(clean[:, 1:]).max(axis=0)
    rows[:, 1:] += spread * random.standard_normal(rows[:, 1:].shape)
    errors = np.tile(spread, (len(rows), 1))
    header = ",".join(["t", *QUANTITIES, *(f"sigma_{name}" for name in QUANTITIES)])
    curve = folder / f"{seed}.csv"
    np.savetxt(curve, np.hstack([rows, errors]), delimiter=",", header=header, comments="")
    given = {
        "data": str(curve),
        "quantities": QUANTITIES,
        "parameters": {key: {"start": START[key], "bounds": [0.01, 10]} for key in keys},
    }
    parameters = from_mapping(PAD | changes | {"fit": given})
    model = Model(parameters, read_experiments(parameters), (folder,), MPI.COMM_WORLD)
    return Search(model, variables_of(parameters), Monitor())


def test_the_numbers_of_twenty_noisy_pads_lie_within_two_errors(
    clean: FloatArray, tmp_path: Path
) -> None:
    inside, evaluations = [], []
    for seed in range(20):
        one = search(clean, seed, list(TRUTH), tmp_path)
        found = one.run()
        assert found.converged
        evaluations.append(one.evaluations)
        inside += list(np.abs(found.numbers - list(TRUTH.values())) <= 2.0 * found.errors)
    assert np.mean(inside) >= 0.9
    assert np.mean(np.array(evaluations) <= MOST_EVALUATIONS) >= 0.9


def test_a_model_without_the_limit_is_seen_by_its_residuals(tmp_path: Path) -> None:
    clean = curves(contact=DEEPER)
    keys = ["material.elasticity.young", "parameters.mu"]
    unlimited = PAD["material"] | {"locking_limit": math.inf}
    one = search(clean, 0, keys, tmp_path, contact=DEEPER, material=unlimited)
    told = one.content(one.run())["words"]
    assert any("times their standard errors" in text for text in told)
