"""Manufactured solutions: sources by sympy for a chosen displacement and a chosen pressure.

The body is the unit square or cube on its foundation below; all other sides have the exact
displacement prescribed.  With ``t = mu(|u_tau|) R p u_tau/sqrt(|u_tau|^2 + eps^2)`` the sources are

    f0 = -Div (A eps(u) + R_n(eps(u))) in the body,
    gap = u_nu - eps p_0  and the traction  sigma nu + p nu + t, p = [p_0]^+, on Gamma_C,

so that ``p = [u_nu - gap]^+/eps`` holds.  For the inequality itself ``gap = u_nu + [-p_0]^+``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sympy as sp
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import with_changes

from contact_locking.arrays import FloatArray
from contact_locking.fem.spaces import P1, Element
from contact_locking.laws.body import lame_from_young
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.running.assembly import StudyProblem, assemble

YOUNG, POISSON = 1.0, 0.3
SYMBOLS = sp.symbols("x y z", real=True)
X, Y, Z = SYMBOLS
_UFL = {name: getattr(ufl, name) for name in ("sin", "cos", "exp", "sqrt", "max_value")} | {
    "Max": ufl.max_value,
    "Heaviside": lambda a, _=0: ufl.conditional(ufl.gt(a, 0.0), 1.0, 0.0),
}


@dataclass(frozen=True)
class Manufactured:
    """``displacement`` (d,) and ``pressure`` p_0 as sympy expressions, with the data of (25).

    ``smoothed`` is ``R p`` for the given ``smoothing``; None stands for no contact at all.
    """

    displacement: tuple[Any, ...]
    pressure: Any | None = None
    smoothed: Any = None
    smoothing: dict[str, Any] = field(default_factory=lambda: {"kernel": "none"})
    friction: str | float = 0.0
    limit: float = math.inf
    n: float = 10.0
    epsilon: float = 0.1
    element: Element = P1

    @property
    def dim(self) -> int:
        return len(self.displacement)

    @property
    def strain(self) -> sp.Matrix:
        gradient = sp.Matrix(self.displacement).jacobian(SYMBOLS[: self.dim])
        return (gradient + gradient.T) / 2

    @property
    def strain_norm(self) -> Any:
        return sp.sqrt(sum(entry**2 for entry in self.strain))

    @property
    def stress(self) -> sp.Matrix:
        """``A eps(u) + R_n(eps(u))``."""
        lame_lambda, lame_mu = lame_from_young(YOUNG, POISSON)
        eps = self.strain
        stress = lame_lambda * eps.trace() * sp.eye(self.dim) + 2.0 * lame_mu * eps
        if math.isfinite(self.limit):
            size = self.strain_norm
            stress += 2.0 * self.n * sp.Max(size - self.limit, 0) / size * eps
        return stress

    def body_force(self) -> list[Any]:
        stress, axes = self.stress, SYMBOLS[: self.dim]
        return [
            -sum(sp.diff(stress[i, j], axes[j]) for j in range(self.dim)) for i in range(self.dim)
        ]

    def contact_load(self) -> list[Any]:
        """``sigma nu + p nu + t`` at the bottom, where ``nu`` is minus the last axis."""
        down = sp.Matrix([0] * (self.dim - 1) + [-1])
        load = self.stress * down
        if self.pressure is not None:
            load += sp.Max(self.pressure, 0) * down + self._friction()
        return [entry.subs(SYMBOLS[self.dim - 1], 0) for entry in load]

    def gap(self) -> Any:
        assert self.pressure is not None
        normal = -self.displacement[-1].subs(SYMBOLS[self.dim - 1], 0)
        if self.epsilon == 0.0:
            return normal + sp.Max(-self.pressure, 0)
        return normal - self.epsilon * self.pressure

    def _friction(self) -> sp.Matrix:
        if self.friction == 0.0:
            return sp.zeros(self.dim, 1)
        slip = sp.Matrix([*self.displacement[:-1], 0])
        square = sum(entry**2 for entry in slip)
        mu = sp.sympify(self.friction).subs("s", sp.sqrt(square))
        return mu * self.smoothed * slip / sp.sqrt(square + self.epsilon**2)

    def assembled(
        self, h: float, comm: MPI.Intracomm = MPI.COMM_WORLD, **changes: Any
    ) -> StudyProblem:
        """The discrete problem on a regular grid, with the sources in place of its loads."""
        sides = ["left", "right", "top"] + ["front", "back"] * (self.dim - 2)
        values = [str(component) for component in self.displacement]
        contact: dict[str, Any] = {"on": []}
        if self.pressure is not None:
            contact = {"on": "bottom", "gap": _text(self.gap())}
        cells = "box" if self.element.boxes else "simplex"
        mesh = {"builder": "block", "dim": self.dim, "h": h, "structured": True, "cells": cells}
        data: dict[str, Any] = {
            "mesh": mesh,
            "material": {
                "elasticity": {"young": YOUNG, "poisson": POISSON},
                "locking_limit": self.limit,
            },
            "loads": {"displacements": [{"on": sides, "value": values}]},
            "contact": contact,
            "friction": {"coefficient": self.friction, "smoothing": self.smoothing},
            "penalty": {"n": self.n, "epsilon": self.epsilon or None},
        }
        made = assemble(with_changes(data, **changes), comm, element=self.element)
        made_mesh = made.domain.mesh
        metadata = {"quadrature_degree": 4}
        v = ufl.TestFunction(made.u.function_space)
        inside = ufl.Measure("dx", made_mesh, metadata=metadata)
        bottom = made.domain.ds(("bottom",), "contact.on", quadrature_degree=4)
        loads = ufl.inner(_ufl(self.body_force(), made_mesh), v) * inside
        loads += ufl.inner(_ufl(self.contact_load(), made_mesh), v) * bottom
        made.data = dataclasses.replace(made.data, loads=loads)
        return made

    def solved(self, h: float, **changes: Any) -> StudySolution:
        solution = solving.solve_assembled(self.assembled(h, **changes))
        assert solution.converged, solution.summary["reason"]
        return solution

    def errors(self, solution: StudySolution) -> Errors:
        """The errors against the exact displacement and total stress; collective."""
        mesh, u = solution.domain.mesh, solution.displacement
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": 6})
        exact = _ufl(self.displacement, mesh)
        eps = ufl.sym(ufl.grad(u)) - _tensor(self.strain, mesh)
        stress = solution.elastic_stress + solution.locking_stress - _tensor(self.stress, mesh)
        lame_lambda, lame_mu = lame_from_young(YOUNG, POISSON)
        elastic = lame_lambda * ufl.tr(eps) ** 2 + 2.0 * lame_mu * ufl.inner(eps, eps)

        def root(density: Any) -> float:
            local = fem.assemble_scalar(fem.form(density * dx))
            return float(np.sqrt(abs(solution.domain.comm.allreduce(local))))

        return Errors(
            l2=root(ufl.inner(u - exact, u - exact)),
            v=root(ufl.inner(eps, eps)),
            energy=root(elastic),
            with_locking=root(ufl.inner(stress, eps)),
        )


@dataclass(frozen=True)
class Errors:
    """L2, V, energy norm, and ``sqrt(int (s - s_h) : (e - e_h))`` of an error."""

    l2: float
    v: float
    energy: float
    with_locking: float


def rate(sizes: Sequence[float], errors: Sequence[float]) -> float:
    """The slope of a line through the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def sampled(expression: Any, dim: int, count: int = 21) -> FloatArray:
    """Values on a grid over the body."""
    grid = np.meshgrid(*[np.linspace(0.0, 1.0, count)] * dim)
    function = sp.lambdify(SYMBOLS[:dim], expression, "numpy")
    return np.broadcast_to(np.asarray(function(*grid), dtype=float), grid[0].shape)


def _text(expression: Any) -> str:
    """The expression in the syntax of the study file."""
    return str(expression).replace("Max(", "max(")


def _ufl(expressions: Sequence[Any], mesh: Any) -> Any:
    """A UFL vector of sympy expressions."""
    x = ufl.SpatialCoordinate(mesh)
    dim = mesh.geometry.dim
    function = sp.lambdify(SYMBOLS[:dim], list(expressions), [_UFL], cse=True)
    zero = 0.0 * x[0]  # numbers alone are no UFL expressions
    return ufl.as_vector([component + zero for component in function(*(x[i] for i in range(dim)))])


def _tensor(matrix: sp.Matrix, mesh: Any) -> Any:
    dim = matrix.shape[0]
    flat = _ufl(list(matrix), mesh)
    return ufl.as_tensor([[flat[dim * i + j] for j in range(dim)] for i in range(dim)])
