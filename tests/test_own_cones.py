"""A new family of cones is one class and one entry of the list of families."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import block
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.laws.elasticity import strain
from contact_locking.laws.locking import locking_energy
from contact_locking.laws.penalty import Penalty
from contact_locking.problem import compiled
from contact_locking.problem.assembly import Problem, assemble
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver import Task
from contact_locking.solver.interior_point import InteriorPoint, method
from contact_locking.solver.interior_point.families import Families, families_of
from contact_locking.solver.interior_point.locking_cones import LockingCones
from contact_locking.solver.interior_point.lorentz import Lorentz
from contact_locking.solver.target import Target
from contact_locking.solving import solve_assembled

LIMIT = 0.01


class ShapeCones(LockingCones):
    """``|dev eps| <= LIMIT``: the change of shape is limited, beside the strain itself."""

    def see(self, displacement: FloatArray) -> FloatArray:
        eps, dim = super().see(displacement), self._strains.dim
        eps[:dim] -= eps[:dim].mean(axis=0)
        return eps

    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        # W is the deviator of a tensor, so that W : eps = W : dev eps.
        whole = super().tangent_term(v, du)
        traces = ufl.div(du) * ufl.div(v) / self._strains.dim
        return whole - self._a * traces * self._strains.dx


def _with_shape(system: PenalisedSystem, target: Target, least_bound: float) -> Families:
    families = families_of(system, target, least_bound)
    strains = families.strains
    limit = np.full(len(strains.weights), LIMIT)
    cones = ShapeCones(Lorentz(system.comm), strains, limit, target.penalty.compliance)
    families.every.append(cones)
    return families


def _by_interior_point(problem: Problem, n: float) -> float:
    """Leave the solution in ``problem.u``; the elastic energy; collective."""
    system = PenalisedSystem(problem.data, problem.u, problem.constraints)
    material, epsilon = problem.material, 1.0 / n
    scales = material.stiffness, material.ellipticity, material.young
    target = Target(Penalty(n, epsilon, (material.young * epsilon,)), *scales, 1.0, 1.0)
    solver = InteriorPoint(Task(system, target))
    solver.solve()
    solver.destroy()
    return system.energy()


def _largest_change_of_shape(u: fem.Function, comm: MPI.Intracomm) -> float:
    deviator = ufl.dev(strain(u))
    size = ufl.sqrt(ufl.inner(deviator, deviator))
    cells = ufl.TestFunction(fem.functionspace(u.function_space.mesh, ("DG", 0)))
    form = size / ufl.CellVolume(u.function_space.mesh) * cells * ufl.dx
    local = fem.assemble_vector(compiled.form(form)).array.max(initial=0.0)
    return float(comm.allreduce(float(local), op=MPI.MAX))


def test_a_new_set_of_strains_is_kept_by_the_inequality(
    monkeypatch: pytest.MonkeyPatch, comm: MPI.Intracomm
) -> None:
    parameters = block(2, 0.2, material__locking_limit=0.015, penalty__n=np.inf)
    without = assemble(parameters, comm)
    _by_interior_point(without, np.inf)
    assert _largest_change_of_shape(without.u, comm) > 1.1 * LIMIT
    monkeypatch.setattr(method, "families_of", _with_shape)
    limited = assemble(parameters, comm)
    _by_interior_point(limited, np.inf)
    assert _largest_change_of_shape(limited.u, comm) == pytest.approx(LIMIT, rel=1e-6)


def test_a_new_set_of_strains_agrees_with_its_penalty_as_an_own_energy(
    monkeypatch: pytest.MonkeyPatch, comm: MPI.Intracomm
) -> None:
    n = 1e3
    newton = assemble(block(2, 0.2, material__locking_limit=0.015, penalty__n=n), comm)
    one_over = fem.Constant(newton.domain.mesh, 1.0 / LIMIT)

    def energy(u: fem.Function) -> Expr:
        return locking_energy(ufl.dev(strain(u)), one_over, newton.data.n) * newton.data.dx

    newton.data = dataclasses.replace(newton.data, own_energy=energy)
    penalised = solve_assembled(newton)
    assert penalised.converged
    monkeypatch.setattr(method, "families_of", _with_shape)
    interior = assemble(block(2, 0.2, material__locking_limit=0.015, penalty__n=n), comm)
    energy_of_cones = _by_interior_point(interior, n)
    assert energy_of_cones == pytest.approx(penalised.summary["elastic_energy"], rel=1e-6)
