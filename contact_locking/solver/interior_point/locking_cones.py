"""Limits of the strain as families of cones: balls of norms, and half lines of half spaces."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx import mesh as dmesh
from dolfinx.fem import petsc
from petsc4py import PETSc
from ufl.core.expr import Expr

from contact_locking.arrays import BoolArray, FloatArray, IndexArray
from contact_locking.fem import compiled
from contact_locking.fem.compiled import Kept
from contact_locking.laws.body import mandel_factor, mandel_vector
from contact_locking.parallel import minimum
from contact_locking.plain_text import coordinates
from contact_locking.problem.forms import ProblemData
from contact_locking.problem.rounding import ROUNDING
from contact_locking.problem.strain_sets import StrainSet
from contact_locking.solver.interior_point.balls import Balls
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.half_lines import HalfLines
from contact_locking.solver.interior_point.lorentz import aligned, norm
from contact_locking.solver.task import Multipliers


class StrainOperator:
    """``v -> L eps(v)`` at the k points of this rank that a set of strains limits, and its adjoint.

    L is the linear map of the set ``law``; values and multipliers are Mandel vectors (m, k), with
    m = 1 for a scalar L.

    - ``limit``, ``weights``: M and the weights of the locking rule, (k,); ``dx`` is its measure
    - ``cells``, ``dofs``: (k,) the cells, and the dofs in the spaces ``scalars`` and ``tensors``
    - ``rows``: m
    """

    def __init__(
        self, space: fem.FunctionSpace, data: ProblemData, law: StrainSet, kept: Kept
    ) -> None:
        mesh, element, dx = space.mesh, data.element, data.locking_dx
        self.comm, self.dim = mesh.comm, mesh.topology.dim
        self.space, self.dx, self.law, self.strain = space, dx, law, element.strain
        self.dofs, self.cells, self.limit = _limited_points(law.inverse_limit)
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self._pairs = element.kinematics.mandel_pairs(self.dim)
        vector = self._vector(element.strain(ufl.TrialFunction(space)))
        self.rows = vector.ufl_shape[0]

        def strains() -> fem.Form:
            test = ufl.TestFunction(element.shared_strain_space(kept, mesh, (self.rows,)))
            return compiled.form(ufl.inner(vector, test) * dx)

        form = kept(("strains", law), strains)
        by_cell = petsc.create_matrix(form)
        # At least half of the entries are zero: a normal strain depends on one component only.
        by_cell.setOption(PETSc.Mat.Option.IGNORE_ZERO_ENTRIES, True)
        petsc.assemble_matrix(by_cell, form)
        by_cell.assemble()
        self._matrix = self._by_component(by_cell)
        by_cell.destroy()
        self.scalars = element.shared_strain_space(kept, mesh)
        self.tensors = element.shared_strain_space(kept, mesh, element.strain_shape(mesh))
        weights: FloatArray = kept(
            "locking weights",
            lambda: fem.assemble_vector(compiled.form(ufl.TestFunction(self.scalars) * dx)).array,
        )
        self.weights = weights[self.dofs]
        self._displacement, self._integrals = self._matrix.createVecs()

    def _vector(self, eps: Expr) -> Expr:
        """``L eps`` as a Mandel vector, or with one row for a scalar."""
        measured = self.law.measured(eps)
        if measured.ufl_shape:
            return mandel_vector(measured, self._pairs)
        return ufl.as_vector([measured])

    def strains(self, displacement: FloatArray) -> FloatArray:
        """``L eps`` (m, k) of a displacement, of which only the owned values count; collective."""
        self._displacement.array_w[:] = displacement[: self._owned]
        self._matrix.mult(self._displacement, self._integrals)
        return self._integrals.array_r.reshape(self.rows, -1) / self.weights

    def add_forces(self, multipliers: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += int y : L eps(.)``; collective."""
        self._integrals.array_w[:] = multipliers.reshape(-1)
        self._matrix.multTransposeAdd(self._integrals, forces, forces)

    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        """The matrix of ``v -> directions . L eps(v)`` at points (p,) of this rank; collective."""
        columns = len(self.limit) * np.arange(self.rows)[None, :] + points[:, None]
        columns += self._matrix.getOwnershipRange()[0]
        starts = self.rows * np.arange(len(points) + 1)
        combination = PETSc.Mat().createAIJ(
            ((len(points), None), (self._matrix.getLocalSize()[0], None)),
            csr=(
                starts.astype(PETSc.IntType),
                columns.reshape(-1).astype(PETSc.IntType),
                (directions / self.weights[points]).T.reshape(-1),
            ),
            comm=self.comm,
        )
        matrix = combination.matMult(self._matrix)
        combination.destroy()
        return matrix

    def set_tensors(self, function: fem.Function, mandel: FloatArray) -> None:
        """Set the values of a function of ``tensors`` to Mandel vectors (m, k); collective."""
        tensors = function.x.array.reshape(-1, *function.ufl_shape)
        for row, (i, j) in zip(mandel, self._pairs, strict=True):
            tensors[self.dofs, i, j] = tensors[self.dofs, j, i] = row / mandel_factor(i, j)
        function.x.scatter_forward()

    def mandel(self, function: fem.Function) -> FloatArray:
        """The Mandel vectors (m, k) of a function of ``tensors``."""
        tensors = function.x.array.reshape(-1, *function.ufl_shape)
        rows = [mandel_factor(i, j) * tensors[self.dofs, i, j] for i, j in self._pairs]
        return np.array(rows)

    def set_values(self, function: fem.Function, values: FloatArray) -> None:
        """Set the values of a function of ``scalars`` at the points (k,); collective."""
        function.x.array[self.dofs] = values
        function.x.scatter_forward()

    def describe_excess(self, ratio: FloatArray, what: str) -> str:
        """Where ``ratio`` (k,), a measure over its limit, is largest; "" below 1.  Collective."""
        local: tuple[float, list[float]] = (0.0, [])
        if len(ratio):
            worst = int(np.argmax(ratio))
            mesh = self.space.mesh
            cell = self.cells[worst : worst + 1]
            place = dmesh.compute_midpoints(mesh, self.dim, cell)[0, : self.dim]
            local = float(ratio[worst]), place.tolist()
        largest, place = max(self.comm.allgather(local))
        if largest <= 1.0:
            return ""
        at = coordinates(place)
        return f"{what} is forced to {largest:.2g} times its limit near ({at})"

    def nodes_at(self, points: BoolArray) -> IndexArray:
        """The owned nodes of the cells that have a marked point (k,), on any rank; collective."""
        touched = fem.Function(self.space)
        blocks = self.space.dofmap.list[self.cells[points]]
        touched.x.array.reshape(-1, self.dim)[blocks.reshape(-1)] = 1.0
        touched.x.scatter_reverse(la.InsertMode.add)
        is_touched = touched.x.array[: self._owned].reshape(-1, self.dim)[:, 0] > 0.0
        return np.flatnonzero(is_touched).astype(np.int32)

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        for petsc_object in (self._matrix, self._displacement, self._integrals):
            petsc_object.destroy()

    def _by_component(self, by_cell: PETSc.Mat) -> PETSc.Mat:
        """The rows of the limited points, ordered by component."""
        starts, columns, values = by_cell.getValuesCSR()
        rows = (np.arange(self.rows)[:, None] + self.rows * self.dofs).reshape(-1)
        counts = np.diff(starts)[rows]
        ends = np.cumsum(counts)
        taken = np.arange(counts.sum()) + np.repeat(starts[rows] - ends + counts, counts)
        return PETSc.Mat().createAIJ(
            ((len(rows), None), by_cell.getSizes()[1]),
            csr=(np.append(0, ends).astype(PETSc.IntType), columns[taken], values[taken]),
            comm=by_cell.getComm(),
        )


def _limited_points(inverse_limit: fem.Function) -> tuple[IndexArray, IndexArray, FloatArray]:
    """The owned points with a limit: their dofs, cells and M, (k,) each."""
    space = inverse_limit.function_space
    topology = space.mesh.topology
    owned = topology.index_map(topology.dim).size_local
    # The dofs of the space of strains need not be in the order of the cells.
    by_cell = space.dofmap.list[:owned]
    dofs = by_cell.reshape(-1)
    cells = np.repeat(np.arange(owned, dtype=np.int32), by_cell.shape[1])
    inverse = inverse_limit.x.array[dofs]
    locks = inverse > 0.0
    return dofs[locks], cells[locks], 1.0 / inverse[locks]


class LimitsOfStrain(Family):
    """Cones at the points of ``strains``, for the set of strains with the index ``number``.

    ``limit`` (k,) is M, and ``compliance`` is 1/(2n), which is 0 for n = inf.
    """

    limit: FloatArray

    #: Whether the start compares the elastic strain with M; not for limits of one component.
    bounds_norm = True

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        self.strains, self._number, self.compliance = strains, number, compliance
        self.comm, self.weights, self.limit = strains.comm, strains.weights, strains.limit

    @property
    @abstractmethod
    def reach(self) -> FloatArray:
        """The measure (k,) of the present strain that M bounds."""

    @property
    @abstractmethod
    def penalised(self) -> FloatArray:
        """The reactions by the penalty law (23) at the present strain, for n < inf."""

    @abstractmethod
    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int D lin(du) . lin(v)`` in UFL; the coefficients are functions of this family."""

    def see(self, displacement: FloatArray) -> FloatArray:
        return self.strains.strains(displacement)

    def add_forces(self, reactions: FloatArray, forces: PETSc.Vec) -> None:
        self.strains.add_forces(reactions, forces)

    def is_kept(self, margin: float, displacement: float) -> bool:
        return bool(np.all(self.reach <= self.limit * (1.0 + margin + ROUNDING)))

    def is_stiff(self, factor: float, material: float) -> BoolArray:
        """Where D is stiffer than the material, and than its softest point; collective."""
        stiffness = self.stiffest
        return np.asarray(stiffness > factor * max(material, minimum(self.comm, stiffness)))

    def stiff_nodes(self, factor: float, material: float) -> IndexArray:
        return self.strains.nodes_at(self.is_stiff(factor, material))

    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        return self.strains.along(points, directions)

    def describe_excess(self) -> str:
        """Where what was seen exceeds its limit the most, "" below; collective."""
        what = "the strain" if self._number == 0 else f"the strain of {self.strains.law.name}"
        return self.strains.describe_excess(np.maximum(self.reach, 0.0) / self.limit, what)


class LockingCones(LimitsOfStrain, Balls):
    """``|L eps| <= M``, with the linear map L of the ``law`` of ``strains``.

    ``L eps`` and the multipliers y are Mandel vectors (m, k).
    """

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        super().__init__(strains, compliance, number)
        self.x, self.z = np.zeros((2, 1 + strains.rows, len(self.limit)))

    @property
    def reach(self) -> FloatArray:
        return norm(self.seen)

    @property
    def penalised(self) -> FloatArray:
        length = norm(self.seen)
        # The limit is positive; the strain may be zero.
        beyond = np.maximum(length - self.limit, 0.0) / np.maximum(length, self.limit)
        return beyond / self.compliance * self.seen

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.strains.set_tensors(multipliers.parts[self._number], self.reactions)

    def read(self, multipliers: Multipliers) -> FloatArray:
        y = self.strains.mandel(multipliers.parts[self._number])
        return np.vstack([norm(y), -y])

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        return aligned(x, z, np.ones(len(self.weights), dtype=bool))

    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int a L eps(du) : L eps(v) + b (W : L eps(du)) (W : L eps(v))``."""
        places, law = self.strains, self.strains.law
        self._a, self._b = fem.Function(places.scalars), fem.Function(places.scalars)
        self._w = fem.Function(places.tensors)
        eps, eps_v = (law.measured(places.strain(w)) for w in (du, v))
        isotropic = self._a * ufl.inner(eps, eps_v) * places.dx
        along = self._b * ufl.inner(self._w, eps) * ufl.inner(self._w, eps_v)
        return isotropic + along * places.dx

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        self.strains.set_values(self._a, self.a)
        self.strains.set_values(self._b, stiffness[0])
        self.strains.set_tensors(self._w, self.w)


class StrainHalfLines(LimitsOfStrain, HalfLines):
    """``N : eps <= M`` with the multiplier ``y >= 0``."""

    bounds_norm = False

    def __init__(self, strains: StrainOperator, compliance: float, number: int) -> None:
        super().__init__(strains, compliance, number)
        self.x, self.z = np.zeros((2, len(strains.limit)))

    def see(self, displacement: FloatArray) -> FloatArray:
        return super().see(displacement)[0]

    @property
    def reach(self) -> FloatArray:
        return self.seen

    @property
    def penalised(self) -> FloatArray:
        return np.maximum(self.seen - self.limit, 0.0) / self.compliance

    def start(self, level: float, least: float) -> None:
        # The same distance from the limit as that of a norm.
        self.x = np.maximum(self.limit, 1.5 * np.abs(self.seen)) - self.seen
        self.z = np.asarray(level / self.x)

    def sizes(self, deformation: float) -> FloatArray:
        return self.limit + np.abs(self.seen)

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.strains.set_values(multipliers.parts[self._number], self.reactions)

    def read(self, multipliers: Multipliers) -> FloatArray:
        return multipliers.parts[self._number].x.array[self.strains.dofs]

    def tangent_term(self, v: Expr, du: Expr) -> Expr:
        """``int k (N : eps(du)) (N : eps(v))``."""
        places, law = self.strains, self.strains.law
        self._k = fem.Function(places.scalars)
        eps, eps_v = (law.measured(places.strain(w)) for w in (du, v))
        return self._k * eps * eps_v * places.dx

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        self.strains.set_values(self._k, stiffness[0])
