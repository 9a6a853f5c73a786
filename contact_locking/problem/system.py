"""The discrete problem as a solver sees it: displacement, forces and energies, friction bounds."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from petsc4py import PETSc
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.contact.travel import Tools
from contact_locking.fem import compiled
from contact_locking.fem.compiled import JointForm, Kept
from contact_locking.laws.body import squared_norm
from contact_locking.problem import forms
from contact_locking.problem.rounding import LooseMotion, Rounding, largest_displacement
from contact_locking.supports.conditions import Constraints, block_diagonal


class BodyForms:
    """Compiled forms: energies, norms and nodal forces of displacements w; collective.

    Nodal forces are local arrays of the displacement space, ghosts included.
    """

    def __init__(self, space: fem.FunctionSpace, data: forms.ProblemData) -> None:
        self._v, self._data, self._kept = ufl.TestFunction(space), data, Kept()
        self._w, self._forces = fem.Function(space), fem.Function(space)
        # One form for cells and one for facets, as in `JointForm`.
        parts = [data.elasticity, *(spring.form for spring in data.springs)]
        self._energies = [compiled.form(0.5 * bilinear(self._w, self._w)) for bilinear in parts]
        self._elastic = JointForm(forms.elastic_form(self._w, self._v, data))
        self._external = JointForm(forms.external_work(self._v, data))
        self._comm = space.mesh.comm

    def energy(self, w: fem.Function) -> float:
        """``a(w, w)/2``."""
        return sum(self._value(energy, w) for energy in self._energies)

    def strain_norm(self, w: fem.Function) -> float:
        """``|w|_V = |eps(w)|`` in L2 (10)."""
        data = self._data
        dx = data.element.elastic_dx(data.dx)
        return float(
            np.sqrt(self._integral("strain", w, lambda w: squared_norm(data.strain(w)) * dx))
        )

    def elastic_forces(self, w: fem.Function) -> FloatArray:
        """``a(w, .)``."""
        self._w.x.array[:] = w.x.array
        return self._nodal(self._elastic)

    def body_forces(self, w: fem.Function) -> FloatArray:
        """``a(w, .) + J'(w)``, with J = 0 unless the user gives an energy."""
        forces, data = self.elastic_forces(w), self._data
        if data.own_energy is None:
            return forces
        derivative = self._kept("J'", lambda: JointForm(forms.own_forces(self._w, self._v, data)))
        return forces + self._nodal(derivative)

    def own_energy(self, w: fem.Function) -> float:
        """``J(w)``, 0 unless the user gives an energy; NaN where J is not defined."""
        energy = self._data.own_energy
        return 0.0 if energy is None else self._integral("J", w, energy)

    def loads(self) -> FloatArray:
        """``(f, .)`` at the present time."""
        return self._nodal(self._external)

    def eigenstrain_work(self, w: fem.Function) -> float:
        """``-(A eps_0, eps(w))``, 0 without an eigenstrain."""
        if self._data.eigenstrain is None:
            return 0.0
        return self._integral("initial", w, lambda w: forms.initial_work(w, self._data))

    def eigenstrain_forces(self) -> FloatArray:
        """``-(A eps_0, eps(.))``, zeros without an eigenstrain."""
        if self._data.eigenstrain is None:
            return np.zeros_like(self._w.x.array)
        return self._nodal(
            self._kept("work", lambda: JointForm(forms.initial_work(self._v, self._data)))
        )

    def eigenstrain_energy(self) -> float:
        """``(A eps_0, eps_0)/2``, 0 without an eigenstrain."""
        if self._data.eigenstrain is None:
            return 0.0
        return self._integral("eigen", self._w, lambda _: forms.initial_energy(self._data))

    def _integral(self, name: str, w: fem.Function, of: Callable[[fem.Function], Expr]) -> float:
        """An integral of w, compiled when it is first needed."""
        return self._value(self._kept(name, lambda: compiled.form(of(self._w))), w)

    def _value(self, form: fem.Form, w: fem.Function) -> float:
        self._w.x.array[:] = w.x.array
        return float(self._comm.allreduce(fem.assemble_scalar(form)))

    def _nodal(self, form: JointForm) -> FloatArray:
        form.assemble_vector(self._forces.x)
        self._forces.x.scatter_forward()
        return self._forces.x.array.copy()


@dataclass(frozen=True)
class SystemState:
    """What :meth:`System.restore` restores; displacements are local values, ghosts included."""

    displacement: FloatArray
    travels: tuple[float, ...]
    bounds: list[FloatArray]


class System:
    """The state that a solver changes, and the forms that it needs.

    - ``u``: the displacement, with the prescribed values in the constrained dofs at all times
    - ``bounds``, ``tools``: the friction bounds in force, and the travels of pushed foundations
    - ``held_by_contact``, ``held_by_friction``: whether it alone stops some rigid motion
    - ``load``: the loads at the owned dofs, constrained dofs included
    """

    def __init__(
        self,
        data: forms.ProblemData,
        u: fem.Function,
        constraints: Constraints,
        held_by_contact: bool = False,
        held_by_friction: bool = False,
        loose: LooseMotion | None = None,
    ) -> None:
        space = u.function_space
        self.data, self.u, self.contacts, self.bounds = data, u, data.contacts, data.bounds
        self.kept = Kept()
        self.comm, self.dim = space.mesh.comm, space.mesh.topology.dim
        self.constraints = constraints
        constraints.apply(u)
        self.held_by_contact, self.held_by_friction = held_by_contact, held_by_friction
        self.rounding = Rounding(data, u, loose)
        self.forms = BodyForms(space, data)
        self._work = fem.Function(space)
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self.tools = Tools(data.tools)
        self.assemble_loads()

    def assemble_loads(self) -> None:
        """Assemble the loads of the present time; collective."""
        self.load = self.forms.loads()[: self._owned]
        self._load_norm = self._norm(self.load)

    @cached_property
    def bilinear(self) -> ufl.Form:
        """``a(w, v)`` of trial and test functions, for forms that are compiled once."""
        space = self.u.function_space
        v, w = ufl.TestFunction(space), ufl.TrialFunction(space)
        return forms.elastic_form(w, v, self.data)

    @cached_property
    def stiffness(self) -> ufl.Form:
        """The derivative of the forces of the body at ``u``, of trial and test functions."""
        space = self.u.function_space
        v, du = ufl.TestFunction(space), ufl.TrialFunction(space)
        return forms.stiffness(self.u, v, du, self.data)

    @property
    def size(self) -> int:
        """The number of displacement dofs, constrained dofs included."""
        dofmap = self.u.function_space.dofmap
        return int(dofmap.index_map.size_global * dofmap.index_map_bs)

    @property
    def rubbing(self) -> tuple[NodalContact, ...]:
        """The contacts with friction."""
        return tuple(contact for contact in self.contacts if not contact.friction.frictionless)

    def near_nullspace(self) -> PETSc.NullSpace:
        """The rigid body motions, orthonormal, for algebraic multigrid; collective."""
        # Axisymmetric bodies get all motions of the plane as well, because they hardly resist these
        # away from the axis: multigrid takes a third of the iterations.
        return near_nullspace(self.u.x.petsc_vec.duplicate(), self.u.function_space)

    def force_scale(self, tolerance: float) -> float:
        """``max(|f|, |a(u, .)|)`` over all dofs, at least what rounding makes; collective."""
        acting = max(self._load_norm, self._norm(self.forms.elastic_forces(self.u)))
        return self.rounding.raise_above(acting, tolerance)

    def largest_displacement(self) -> float:
        """The largest ``|u|`` of all nodes; collective."""
        return largest_displacement(self.u)

    def energy(self) -> float:
        """``a(u, u)/2``, the elastic energy without an eigenstrain; collective."""
        return self.forms.energy(self.u)

    def elastic_energy(self) -> float:
        """``a(u, u)/2 - (A eps_0, eps(u)) + (A eps_0, eps_0)/2``; collective."""
        eigen = self.forms.eigenstrain_work(self.u) + self.forms.eigenstrain_energy()
        return self.energy() + eigen

    def compliance(self) -> float:
        """The work ``(f, u)`` of the loads, without that of an eigenstrain; collective."""
        work = float(self.comm.allreduce(self.load @ self.u.x.array[: self._owned]))
        return work + self.forms.eigenstrain_work(self.u)

    def _norm(self, forces: FloatArray) -> float:
        square = float(np.sum(forces[: self._owned] ** 2))
        return float(np.sqrt(self.comm.allreduce(square)))

    def clear(self) -> None:
        """Set u at free dofs, friction bounds and travels to zero; collective."""
        self.u.x.array[:] = 0.0
        self.constraints.apply(self.u)
        self.remove_friction()
        self.tools.travels = (0.0,) * len(self.tools)

    def remove_friction(self) -> None:
        """Set every friction bound to zero; collective."""
        for contact in self.contacts:
            self.bounds[contact] = np.zeros(len(contact.free))

    @contextlib.contextmanager
    def preserved(self, only_on_failure: bool = False) -> Iterator[None]:
        """Restore the displacement, travels and friction bounds after the block; collective.

        With ``only_on_failure`` they are restored only if the block raises an exception.
        """
        state = self.state()
        try:
            yield
        except BaseException:
            self.restore(state)
            raise
        if not only_on_failure:
            self.restore(state)

    def state(self) -> SystemState:
        """A copy of displacement, travels and friction bounds."""
        bounds = self.bounds.at(self.contacts)
        return SystemState(self.u.x.array.copy(), self.tools.travels, bounds)

    def restore(self, state: SystemState) -> None:
        """Set displacement, travels and friction bounds."""
        self.u.x.array[:] = state.displacement
        self.tools.travels = state.travels
        self.bounds.set(self.contacts, state.bounds)

    def function_of(self, values: FloatArray) -> fem.Function:
        """A displacement field with these owned values; collective."""
        field = fem.Function(self.u.function_space)
        field.x.array[: self._owned] = values[: self._owned]
        field.x.scatter_forward()
        return field


def near_nullspace(vector: PETSc.Vec, space: fem.FunctionSpace) -> PETSc.NullSpace:
    """The rigid motions of a space as vectors like ``vector``, which is destroyed; collective."""
    points = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local]
    vector.array_w[:] = points[:, : vector.getBlockSize()].reshape(-1)
    nullspace = PETSc.NullSpace().createRigidBody(vector)
    vector.destroy()
    return nullspace


def affine_part(
    space: fem.FunctionSpace, constraints: Constraints
) -> tuple[PETSc.Mat, PETSc.NullSpace]:
    """The prolongation P from affine to quadratic displacements, and the affine rigid motions.

    Let F project a node's displacement onto the directions that the conditions leave free.  P is
    ``v_1`` at a corner 1, and ``F_m (F_1 v_1 + F_2 v_2)/2`` at the midpoint m of the edge between
    the corners 1 and 2.  So ``P^T A P`` keeps the identity rows that A has for constrained dofs.
    ``space`` is that of the quadratic displacements.  Collective.
    """
    dim = space.dofmap.index_map_bs
    affine = fem.functionspace(space.mesh, ("P", 1, (dim,)))
    plain = petsc.interpolation_matrix(affine, space)
    plain.assemble()
    count = len(space.tabulate_dof_coordinates())
    # The projections (n, d, d) at local nodes, ghosts included.
    units = (np.tile(row, count) for row in np.eye(dim))
    free = np.stack([constraints.free_part(unit).reshape(-1, dim) for unit in units], axis=2)
    corners = range(affine.dofmap.list.shape[1])
    at_corner = [space.dofmap.dof_layout.entity_dofs(0, corner)[0] for corner in corners]
    nodes = space.dofmap.list[:, at_corner].reshape(-1)
    free_at_corners = np.zeros((len(affine.tabulate_dof_coordinates()), dim, dim))
    free_at_corners[affine.dofmap.list.reshape(-1)] = free[nodes]
    # F at midpoints, and nothing at corners, whose rows are those of the interpolation.
    free[nodes] = 0.0
    left, right = (
        block_diagonal(blocks[: each.dofmap.index_map.size_local], space.mesh.comm)
        for blocks, each in ((free, space), (free_at_corners, affine))
    )
    scaled = plain.matMult(right)
    prolongation = left.matMult(scaled)
    is_corner = plain.createVecLeft()
    is_corner.array_w[:] = np.repeat(np.isin(np.arange(count), nodes), dim)[
        : len(is_corner.array_r)
    ]
    plain.diagonalScale(is_corner)
    prolongation.axpy(1.0, plain, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    prolongation.setBlockSizes(dim, dim)
    for petsc_object in (plain, left, right, scaled, is_corner):
        petsc_object.destroy()
    return prolongation, near_nullspace(prolongation.createVecRight(), affine)
