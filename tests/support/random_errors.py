"""Random problems in 2D with their guaranteed bounds, beside solutions on finer meshes.

The friction bound of the coarse solution is kept fixed on the finer mesh, as the bound is for this
friction bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from problems import with_changes
from transfer import on_mesh_of

from contact_locking.arrays import FloatArray
from contact_locking.contact.coulomb import FrictionBound
from contact_locking.fem.compiled import integral
from contact_locking.fem.spaces import P1, Element
from contact_locking.problem import forms
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters


@dataclass(frozen=True)
class Comparison:
    """A guaranteed bound, and the energy norm of the distance to a solution on a finer mesh."""

    bound: dict[str, Any]
    distance: float

    @property
    def effectivity(self) -> float:
        return float(self.bound["energy_norm"] / self.distance)


def random_block(seed: int) -> Parameters:
    """A block on a regular grid with random material, loads, supports, gap, friction, penalty."""
    random = np.random.default_rng(seed)
    young = float(10.0 ** random.uniform(-1.0, 3.0))
    limit = float(np.round(10.0 ** random.uniform(-2.3, -1.0), 4))
    if random.random() < 0.25:
        limit = np.inf
    scale = min(limit, 0.05)
    elasticity: dict[str, Any] = {"young": young, "poisson": float(random.uniform(0.0, 0.45))}
    if random.random() < 0.3:
        diagonal = np.diag(random.uniform(0.5, 2.0, 3)) + 0.2
        elasticity = {"stiffness": (young * diagonal).tolist()}
    side = str(random.choice(["left", "right"]))
    support: dict[str, Any] = {"on": side, "value": [0.0, 0.0]}
    pull, force = (young * scale * random.uniform(-1.0, 1.0, 2) * size for size in (2.0, 0.5))
    loads: dict[str, Any] = {
        "displacements": [support],
        "tractions": [{"on": "top", "value": pull.tolist()}],
    }
    if random.random() < 0.5:
        loads["body_force"] = force.tolist()
    n = np.inf if random.random() < 0.7 else float(young * 10.0 ** random.uniform(2.0, 6.0))
    return with_changes(
        {
            "mesh": {"builder": "block", "h": 0.25, "structured": True},
            "material": {"elasticity": elasticity, "locking_limit": limit},
            "loads": loads,
            "contact": {"on": "bottom", "gap": f"{scale * random.uniform(0.0, 0.2)!r}*(1 + x)"},
            "friction": {
                "coefficient": float(random.choice([0.0, 0.3, 0.6])),
                "smoothing": {"radius": 0.3},
            },
            "penalty": {"n": n},
            "certificate": {"error_bound": True},
        }
    )


def compared(parameters: Parameters, refinement: int, element: Element = P1) -> Comparison | None:
    """The bound of a problem on a regular grid and the distance from a grid that is finer.

    None for a problem that is not solved on one of the grids.
    """
    coarse = solving.solve(parameters, MPI.COMM_SELF)
    if not coarse.converged:
        return None
    data = parameters.model_dump(by_alias=True)
    data["penalty"] = {}
    data["mesh"]["h"] /= refinement
    fine = Parameters.model_validate(data)
    problem = assemble(fine, MPI.COMM_SELF, element=element)
    keep_friction_bound(problem.contacts, coarse)
    exact = solving.solve_assembled(problem)
    if not exact.converged:
        return None
    found = coarse.summary["certificate"]["errors"]["guaranteed"]
    difference = on_mesh_of(coarse.displacement, exact.displacement)
    difference.x.array[:] -= exact.displacement.x.array
    square = integral(problem.domain, forms.elastic_form(difference, difference, problem.data))
    return Comparison(found, float(np.sqrt(square)))


def keep_friction_bound(contacts: Any, coarse: StudySolution) -> None:
    """Give contacts along the x axis the friction bound of a solution on a coarser mesh."""
    for contact, known in zip(contacts, coarse.contacts, strict=True):
        order = np.argsort(known.surface.points[:, 0])
        x, values = known.surface.points[order, 0], known.bound[order]
        fixed = np.interp(contact.surface.points[:, 0], x, values)

        class Fixed(FrictionBound):
            kept = fixed

            def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
                return self.kept.copy()

        old = contact.friction
        contact.friction = Fixed(contact.surface, old.smoothing, old.law, old.frictionless)
