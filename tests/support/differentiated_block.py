"""A block that locks, touches, sticks and slides, made of numbers that may be changed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

import contact_locking as cl
from contact_locking.arrays import FloatArray

#: The quantities that the tests derive.
NAMES = (
    "compliance",
    "elastic_energy",
    "contact_force.1",
    "friction_force.0",
    "reactions.bcs.0.1",
    "pressure_max",
)


@dataclass
class Block:
    """A problem with the constants and numbers in its data, and their values."""

    problem: cl.ContactProblem
    given: dict[str, fem.Constant | cl.Number]

    def at(self, name: str, value: float) -> FloatArray:
        """The quantities NAMES with another value of one number; collective."""
        return self.values(**{name: value})

    def values(self, **changed: float) -> FloatArray:
        """The quantities NAMES with other numbers, by a solve; collective."""
        before = {name: float(self.given[name].value) for name in changed}
        for name, value in changed.items():
            self.given[name].value = value
        solution = self.problem.solve()
        for name, value in before.items():
            self.given[name].value = value
        assert solution.converged
        return quantities(solution)


def quantities(solution: cl.Solution) -> FloatArray:
    """The quantities NAMES of a solution; collective."""
    summary = solution.summary
    largest = max(float(np.max(item.pressure, initial=0.0)) for item in solution.contacts)
    return np.array(
        [
            summary["compliance"],
            summary["elastic_energy"],
            summary["contact_force"][1],
            summary["friction_force"][0],
            summary["reactions"]["bcs.0"][1],
            MPI.COMM_WORLD.allreduce(largest, op=MPI.MAX),
        ]
    )


def block(
    n: float = math.inf,
    degree: int = 1,
    dim: int = 2,
    cells: int = 8,
    kernel: Any = None,
    coefficient: Callable[[cl.Number], Any] | None = None,
    **settings: Any,
) -> Block:
    """A unit block, clamped on the left and pressed onto the foundation at a gap."""
    comm = MPI.COMM_WORLD
    make = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
    body = make(comm, *[cells] * dim)
    space = fem.functionspace(body, ("Lagrange", degree, (dim,)))
    left = mesh.locate_entities_boundary(body, dim - 1, lambda x: np.isclose(x[0], 0.0))
    bottom = mesh.locate_entities_boundary(body, dim - 1, lambda x: np.isclose(x[dim - 1], 0.0))
    fixed = fem.locate_dofs_topological(space, dim - 1, left)
    clamp = fem.dirichletbc(np.zeros(dim), fixed, space)
    young, limit = fem.Constant(body, 1.0), fem.Constant(body, 0.03)
    pull, press = fem.Constant(body, 0.02), fem.Constant(body, 0.05)
    mu, gap = cl.Number(0.3), cl.Number(0.002)
    v = ufl.TestFunction(space)
    loads = (pull * v[0] - press * v[dim - 1]) * ufl.dx
    law = cl.Coulomb(
        coefficient(mu) if coefficient else lambda x, s: mu.value * np.exp(-s / 0.05),
        kernel or cl.Convolution(0.3),
    )
    problem = cl.ContactProblem(
        cl.Elasticity(young=young, poisson=0.3),
        loads,
        [clamp],
        [cl.StrainBall(limit)],
        [cl.Contact(bottom, friction=law, gap=gap)],
        space=space,
        n=n,
        # Differences of solves show what the solves leave, divided by their width.
        settings=cl.Settings(**{"tolerance": 1e-10, "friction_tolerance": 1e-11} | settings),
    )
    given = {"E": young, "M": limit, "pull": pull, "press": press, "mu": mu, "gap": gap}
    return Block(problem, given)
