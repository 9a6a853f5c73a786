"""Derivatives of random problems of the sweep against central differences of two widths.

A problem has one random number of its study, and each quantity that has a derivative.
"""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import ValidationError

from contact_locking.errors import ContactLockingError, InputError
from contact_locking.inverse.sensitivities import number_at, value_of, with_number
from contact_locking.results.solution import StudySolution
from contact_locking.running.solving import solve
from contact_locking.study_file.dump import plain
from contact_locking.study_file.parameters import Parameters

from .case import Study

# Widths of central differences, relative to the number; those that disagree by more tell nothing.
# What solves leave is ten times as much of the narrow one: widths closer to each other may agree in
# it by chance.
WIDTHS, AGREE = (1e-3, 1e-4), 1e-3
# A derivative is right within the first, and wrong beyond the second if nothing marks it.
RIGHT, WRONG = 1e-3, 1e-2
# A derivative by ``ln p`` below this share of the quantity is judged by that share.
LEAST = 1e-2
# Below this share of the forces of the body a force is zero by symmetry, or the multiplier of what
# does not touch.  Derivatives have an accuracy of 1e-6 of the forces, as solves have.
NOTHING = 1e-3
# Differences show what solves leave, divided by their width.
SHARP = {"tolerance": 1e-10, "friction_tolerance": 1e-11}


@dataclass
class Compared:
    """The derivatives of a problem by one number, with errors of those that differences tell."""

    key: str = ""
    marked: bool = False
    errors: dict[str, float] = field(default_factory=dict)

    def complaint(self) -> str:
        """The derivatives that are wrong and not marked; "" if there are none."""
        wrong = {name: error for name, error in self.errors.items() if error > WRONG}
        if self.marked or not wrong:
            return ""
        return "; ".join(
            f"d {name}/d {self.key} is off by {error:.1e}" for name, error in wrong.items()
        )


def compared(study: Study, seed: int) -> Compared | None:
    """Compare the derivatives of a study; None for one without a number, or without solutions."""
    random = np.random.default_rng([seed, 49])
    data = copy.deepcopy(study)
    data["solver"] = {**data.get("solver", {}), **SHARP}
    for contact in data["contact"] if isinstance(data["contact"], list) else [data["contact"]]:
        if "against" in contact:
            contact["pair"] = "once"
    try:
        parameters = Parameters.model_validate(data)
        keys = list(_keys(parameters))
        if not keys:
            return None
        key = keys[int(random.integers(len(keys)))]
        names = _names(parameters)
        asked = Parameters.model_validate(data | {"sensitivities": {"of": names, "to": [key]}})
        solution = solve(asked)
        if not solution.converged or "sensitivities" not in solution.summary:
            return None
        at, sides = number_at(parameters, key), []
        for width in WIDTHS:
            above, below = (
                _values(with_number(parameters, key, at * (1.0 + side)), names)
                for side in (width, -width)
            )
            if above is None or below is None:
                return None
            sides.append((above - below) / (2.0 * width))
    except (ContactLockingError, ValidationError):
        return None
    wide, narrow = sides
    shares = [v for v in solution.summary["share_at_change"].values() if isinstance(v, float)]
    found = Compared(key, max(shares, default=0.0) > 0.0)
    floors = _floors(solution, names)
    for place, name in enumerate(names):
        size = max(abs(narrow[place]), LEAST * abs(value_of(name, solution)), floors[place])
        mine = at * solution.summary["sensitivities"][name][key]["derivative"]
        if size > 0.0 and abs(wide[place] - narrow[place]) <= AGREE * size:
            found.errors[name] = abs(mine - narrow[place]) / size
    return found


def _floors(solution: StudySolution, names: list[str]) -> list[float]:
    """What is no derivative: forces that symmetry or a distance makes zero, and their pressures."""
    # Of a body that falls onto its foundation first, the load does far more work than it stores.
    energy = max(value_of(name, solution) for name in ("elastic_energy", "compliance"))
    force = energy / (float(solution.summary["displacement_max"]) or 1.0)
    force = max(force, float(np.linalg.norm(solution.summary.get("contact_force") or 0.0)))
    pressure = force / solution.domain.extent ** (solution.domain.dim - 1)
    kinds = {"compliance": energy, "elastic_energy": energy, "pressure_max": pressure}
    return [NOTHING * kinds.get(name, force) for name in names]


def _values(parameters: Parameters, names: list[str]) -> Any:
    solution = solve(parameters)
    if not solution.converged:
        return None
    return np.array([value_of(name, solution) for name in names])


def _keys(parameters: Parameters) -> Iterator[str]:
    """The keys of the study that are numbers other than zero, and that have a derivative."""
    for key in _numbers(plain(parameters)):
        with contextlib.suppress(InputError):
            if number_at(parameters, key) != 0.0:
                yield key


def _numbers(data: Any) -> Iterator[str]:
    """The dotted keys of all numbers."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        if isinstance(value, dict | list):
            yield from (f"{key}.{rest}" for rest in _numbers(value))
        elif isinstance(value, int | float):
            yield str(key)


def _names(parameters: Parameters) -> list[str]:
    dim = parameters.mesh.dim or 2
    names = ["compliance", "elastic_energy"]
    if parameters.contacts:
        names += [f"contact_force.{dim - 1}", "friction_force.0", "pressure_max"]
    return names
