"""The discrete problem at a known friction bound as a second-order cone programme for Clarabel.

    min  1/2 a(u, u) - (f, u) + sum_K |K| n q_K^2 + sum_i w_i (g_i t_i + r_i^2/(2 eps))
    with |eps_K(u)| <= M + q_K,  u_nu,i - gap_i <= r_i,  |(u_tau,i, eps)| <= t_i

over the cells K and the nodes i of Gamma_C; q = 0 for n = inf and r = 0 for eps = 0.  Other sets of
strains may take the place of the ball, each with a q of its own.  Of the solution that it judges it
takes coordinates, connectivity and the bound g, and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree
from simplices import Body, IntArray, Place

from contact_locking.arrays import FloatArray
from contact_locking.results.solution import StudySolution

# The material of every reference problem.
YOUNG, POISSON, LIMIT = 1.0, 0.3, 0.02


@dataclass(frozen=True)
class Contact:
    """Nodes of Gamma_C with their ``weights``, ``gap`` and ``bound``, all (k,); ``normal`` (d,)."""

    nodes: IntArray
    weights: FloatArray
    gap: FloatArray
    bound: FloatArray
    normal: FloatArray


@dataclass(frozen=True)
class StrainCone:
    """``|B eps| <= limit`` in every cell for a matrix B (r, m), or ``B eps <= limit`` for r = 1."""

    matrix: FloatArray
    limit: float

    @property
    def rows(self) -> int:
        return len(self.matrix)

    def excess(self, strains: FloatArray) -> FloatArray:
        """By how much strains (c, m) exceed the limit (c,)."""
        measured = strains @ self.matrix.T
        size = measured[:, 0] if self.rows == 1 else np.linalg.norm(measured, axis=1)
        return np.maximum(size - self.limit, 0.0)


@dataclass(frozen=True)
class ConicProblem:
    """``load`` is the vector of (f, .); the nodes ``held`` have the displacement ``value`` (d,).

    A node that is held has no place in ``contact``, nor has one without a friction bound.  The ball
    of the radius ``limit`` is the only set of strains unless there are ``sets``.
    """

    body: Body
    limit: float
    load: FloatArray
    held: IntArray
    value: FloatArray
    contact: Contact
    n: float = math.inf
    epsilon: float = 0.0
    sets: tuple[StrainCone, ...] = ()

    def energy(self, u: FloatArray) -> float:
        """The objective at a displacement, with the least q, r and t that are feasible."""
        body, contact = self.body, self.contact
        energy = 0.5 * u @ (body.stiffness @ u) - self.load @ u
        slip = np.linalg.norm((self._tangents() @ u).reshape(len(contact.nodes), -1), axis=1)
        energy += contact.weights @ (contact.bound * np.hypot(slip, self.epsilon))
        if math.isfinite(self.n):
            strains = (body.strain @ u).reshape(len(body.volumes), -1)
            for item in self._sets():
                energy += self.n * (body.volumes @ item.excess(strains) ** 2)
        if self.epsilon > 0.0:
            depth = np.maximum(self._normal() @ u - contact.gap, 0.0)
            energy += contact.weights @ depth**2 / (2.0 * self.epsilon)
        return float(energy)

    def minimiser(self, **options: Any) -> FloatArray:
        """The displacement by Clarabel; raises AssertionError if Clarabel does not converge."""
        solution = self.solver(**options).solve()
        assert str(solution.status) in ("Solved", "AlmostSolved"), solution.status
        return self.displacement(solution.x)

    def solver(self, **options: Any) -> Any:
        """Clarabel's solver of this problem with the given settings, ready to solve."""
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        for name, value in options.items():
            setattr(settings, name, value)
        return clarabel.DefaultSolver(*self._standard_form(clarabel), settings)

    def displacement(self, unknowns: Sequence[float]) -> FloatArray:
        """The displacement that is part of the solver's unknowns."""
        free = self._free()
        u = self._start()
        u[free] = np.array(unknowns[: len(free)]) * self._length
        return u

    def _standard_form(self, clarabel: Any) -> tuple[Any, ...]:
        """``min x'Px/2 + q'x, b - Ax in K`` for x = (u, q, r, t) over lengths, the u free."""
        body, contact, length = self.body, self.contact, self._length
        cells, nodes, free = len(body.volumes), len(contact.nodes), self._free()
        start = self._start()
        # Blocks of variables; one without columns stands for what is absent.
        sets = self._sets()
        softens = sp.eye(cells * len(sets) if math.isfinite(self.n) else 0)
        yields = sp.eye(nodes if self.epsilon > 0.0 else 0)
        counts = [len(free), softens.shape[1], yields.shape[1], nodes]
        stiffness = body.stiffness[free][:, free]
        quadratic = [stiffness]
        volumes = np.tile(body.volumes, len(sets))
        quadratic.append(sp.diags(2.0 * self.n * volumes) if counts[1] else softens)
        quadratic.append(sp.diags(contact.weights / self.epsilon) if counts[2] else yields)
        P = sp.block_diag([*quadratic, sp.csc_matrix((nodes, nodes))], "csc") * length
        linear = np.zeros(sum(counts))
        linear[: len(free)] = (body.stiffness @ start - self.load)[free]
        linear[sum(counts[:3]) :] = contact.weights * contact.bound

        def rows(height: int, **blocks: Any) -> sp.csc_matrix:
            parts = [
                blocks.get(name, sp.csc_matrix((height, count)))
                for name, count in zip("uqrt", counts, strict=True)
            ]
            return sp.hstack([part for part in parts if part.shape[1]], "csc")

        def first_of(height: int, count: int) -> sp.csc_matrix:
            return sp.kron(sp.eye(count), sp.csc_matrix(np.eye(height)[:, :1]), "csc")

        A, b, cones = [], [], []
        # Contact: gap - u_nu + r >= 0.
        blocks = {"u": -self._normal()[:, free]} | ({"r": yields} if counts[2] else {})
        A.append(rows(nodes, **blocks))
        b.append(contact.gap - self._normal() @ start)
        cones.append(clarabel.NonnegativeConeT(nodes))
        # Locking: (M + q, B eps), what is measured below a row for the first entry.  One row is
        # M + q - B eps >= 0.
        for number, item in enumerate(sets):
            size = 1 + item.rows if item.rows > 1 else 1
            below = np.vstack([np.zeros((1, item.rows)), np.eye(item.rows)])
            below = (below if item.rows > 1 else -np.eye(1)) @ item.matrix
            measured = sp.kron(sp.eye(cells), sp.csc_matrix(below), "csc") @ body.strain
            blocks = {"u": measured[:, free]}
            if counts[1]:
                own = sp.eye(cells, counts[1], k=cells * number)
                blocks["q"] = first_of(size, cells) @ own
            A.append(rows(size * cells, **blocks))
            b.append(first_of(size, cells) @ np.full(cells, item.limit) + measured @ start)
            many = [clarabel.SecondOrderConeT(size)] * cells
            cones += many if item.rows > 1 else [clarabel.NonnegativeConeT(cells)]
        # Friction: (t, u_tau, eps).
        size = 1 + (body.dim - 1) + (self.epsilon > 0.0)
        below = sp.kron(sp.eye(nodes), sp.csc_matrix(np.eye(size)[:, 1 : body.dim]), "csc")
        height = size * nodes
        A.append(rows(height, u=below @ self._tangents()[:, free], t=first_of(size, nodes)))
        b.append(below @ (self._tangents() @ start))
        if self.epsilon > 0.0:
            b[-1][size - 1 :: size] = self.epsilon
        cones += [clarabel.SecondOrderConeT(size)] * nodes
        return (
            sp.triu(P, format="csc") / self._force,
            linear / self._force,
            -sp.vstack(A, "csc"),
            np.concatenate(b) / length,
            cones,
        )

    def _sets(self) -> tuple[StrainCone, ...]:
        entries = self.body.strain.shape[0] // len(self.body.volumes)
        return self.sets or (StrainCone(np.eye(entries), self.limit),)

    @property
    def _length(self) -> float:
        """Displacements in this unit have strains about as large as the limit."""
        return self.limit * float(np.ptp(self.body.x, axis=0).max())

    @property
    def _force(self) -> float:
        """The objective in this unit times a length is about one."""
        return float(self.body.stiffness.diagonal().max()) * self._length

    def _free(self) -> IntArray:
        mask = np.ones(self.body.x.shape, dtype=bool)
        mask[self.held] = False
        return np.flatnonzero(mask)

    def _start(self) -> FloatArray:
        """The displacement with the held nodes in their places and all others at rest."""
        u = np.zeros(self.body.x.shape)
        u[self.held] = self.value
        return u.ravel()

    def _normal(self) -> sp.csc_matrix:
        """``u -> u_nu``, (k, dofs)."""
        return self._at_nodes(self.contact.normal[None, :])

    def _tangents(self) -> sp.csc_matrix:
        """``u -> u_tau`` in an orthonormal basis of the tangents, (k (d - 1), dofs)."""
        return self._at_nodes(np.linalg.svd(self.contact.normal[None, :])[2][1:])

    def _at_nodes(self, directions: FloatArray) -> sp.csc_matrix:
        return sp.kron(self.body.values(self.contact.nodes), directions, "csc")


def conic_problem(
    solution: StudySolution,
    touches: Place,
    held: Place,
    value: list[float],
    pulled: Place = lambda x: np.zeros(x.shape[:-1], dtype=bool),
    traction: Sequence[float] = (),
    elements: type[Body] = Body,
) -> ConicProblem:
    """The problem of a solution at its friction bound; places are those of nodes (..., d).

    The foundation is the plane through the origin, below the body.
    """
    space = solution.displacement.function_space
    dim = solution.domain.dim
    x = space.tabulate_dof_coordinates()[:, :dim]
    body = elements(x, space.dofmap.list, YOUNG, POISSON)
    force = np.array(traction or [0.0] * dim)
    load = body.shares_of_loads(body.facets(pulled))[:, None] * force
    areas = body.nodal_areas(body.facets(touches))
    areas[held(x)] = 0.0
    nodes = np.flatnonzero(areas)
    points = solution.contact_points
    assert points is not None
    distance, match = cKDTree(points.x).query(x[nodes])
    np.testing.assert_allclose(distance, 0.0, atol=1e-12)
    contact = Contact(nodes, areas[nodes], x[nodes, -1], points.bound[match], -np.eye(dim)[-1])
    penalty = solution.parameters.penalty
    return ConicProblem(
        body,
        LIMIT,
        load.ravel(),
        np.flatnonzero(held(x)),
        np.array(value),
        contact,
        n=penalty.n,
        epsilon=penalty.epsilon or 0.0,
    )


def block_problem(solution: StudySolution, elements: type[Body] = Body) -> ConicProblem:
    """The conic problem of ``problems.block``."""
    pull = [0.03, -0.05] if solution.domain.dim == 2 else [0.03, 0.0, -0.05]
    return conic_problem(
        solution,
        touches=lambda x: x[..., -1] < 1e-9,
        held=lambda x: x[..., 0] < 1e-9,
        value=[0.0] * len(pull),
        pulled=lambda x: x[..., -1] > 1.0 - 1e-9,
        traction=pull,
        elements=elements,
    )
