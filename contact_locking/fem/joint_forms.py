"""Forms whose integrals have arguments in different spaces with the same degrees of freedom.

The body's integrals have displacements as arguments.  Those over Gamma_C have fields of the limited
space, whose degrees of freedom are those of the displacement (`PointValues`).

For each cell and facet of a form DOLFINx stores all coefficients of the form.  Cells and facets
have forms of their own, so that no cell stores coefficients of Gamma_C.

FFCx 0.9 treats values at the only point of a quadrature rule as constant in the cell, and
uses that in the other rules of the same form, too.  So integrals that evaluate the coordinates in
one point, as all of an axisymmetric body do with linear displacements, have forms of their own.
The same of arguments loses a traction, in one point of a facet, beside the nodes of a contact
there: the rules of facets have forms of their own.

Where two bodies touch, the limited values are jumps (:class:`~.jump.JumpValues`), with the map T
from displacements.  The forms of their space are assembled there, and carried over: forces by
``T^T f`` and stiffness by ``T^T K T``, which couples degrees of freedom of different cells.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import ufl
from dolfinx import fem, la
from dolfinx.fem import petsc
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.fem import compiled

if TYPE_CHECKING:
    from contact_locking.fem.jump import JumpValues

# By this name a PETSc matrix keeps the matrix of DOLFINx whose arrays it shares.
_SHARED = "shared_with_dolfinx"


def by_space(form: ufl.Form) -> list[ufl.Form]:
    """The integrals of a form, in forms that can be compiled together, those of cells first.

    These are one form for each space of the arguments, for the cells and for each quadrature rule
    of the facets, or two if some integrals evaluate the coordinates in one point; and one for each
    object of mesh tags, of which DOLFINx takes one for all integrals of a form.
    """
    groups: dict[Any, list[Any]] = {}
    for integral in form.integrals():
        space = ufl.algorithms.extract_arguments(integral.integrand())[0].ufl_function_space()
        kind, tags = integral.integral_type(), id(integral.subdomain_data())
        of_facets = None if kind == "cell" else integral.metadata().get("quadrature_rule")
        key = id(space), kind, of_facets, _is_at_one_point(integral), tags
        groups.setdefault(key, []).append(integral)
    return [ufl.Form(integrals) for integrals in sorted(groups.values(), key=_rank)]


def _rank(integrals: list[Any]) -> tuple[bool, bool]:
    """The order of forms: those over all cells first, as they have all entries of a matrix."""
    is_everywhere = any(item.subdomain_id() == "everywhere" for item in integrals)
    return integrals[0].integral_type() != "cell", not is_everywhere


def _is_at_one_point(integral: Any) -> bool:
    """Whether an integral evaluates the coordinates in one point of a cell or facet."""
    if integral.metadata().get("quadrature_degree", 2) > 1:
        return False
    places = ufl.algorithms.analysis.extract_type(integral, ufl.SpatialCoordinate)
    return bool(places)


def action(bilinear: ufl.Form, u: fem.Function) -> ufl.Form:
    """``b(u, .)``, each part with the function that has the degrees of freedom of u."""
    form = ufl.Form([])
    for part in by_space(bilinear):
        space = part.arguments()[1].ufl_function_space()
        form += ufl.action(part, u if space is u.function_space else fem.Function(space, x=u.x))
    return form


class JointForm:
    """A compiled form, in the parts of :func:`by_space`; local arrays have the displacement's dofs.

    The integrals with displacements as arguments come first.  ``jumps`` are those that limit
    displacements in the form.  ``compile_form`` compiles each part.
    """

    def __init__(
        self,
        form: ufl.Form,
        jumps: Sequence[JumpValues] = (),
        compile_form: Callable[[ufl.Form], fem.Form] = compiled.form,
    ) -> None:
        every, spaces = by_space(form), [item.space for item in jumps]
        self._parts = [part for part in every if not any(_space(part) is space for space in spaces)]
        self._forms = [compile_form(part) for part in self._parts]
        self._jumps = [
            _FormOfJump(jump, part, compile_form)
            for jump in jumps
            for part in every
            if _space(part) is jump.space
        ]

    def create_matrix(self, kind: str | None = None) -> PETSc.Mat:
        """A matrix with the sparsity of the first part, the cells' integrals; collective.

        Jumps add the entries that they have, in a matrix that is stored entry by entry.
        """
        if not self._jumps:
            return petsc.create_matrix(self._forms[0], kind)
        matrix = petsc.create_matrix(self._forms[0])
        # PETSc forgets the places of entries that nobody has given a value.
        petsc.assemble_matrix(matrix, self._forms[0])
        matrix.assemble()
        numbering = matrix.getLGMap()
        for item in self._jumps:
            stiffness = item.stiffness(None)
            matrix.axpy(1.0, stiffness, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            stiffness.destroy()
        if kind is not None:
            matrix.convert(kind)
        matrix.setLGMap(*numbering)
        return matrix

    def create_shared_matrix(self) -> PETSc.Mat:
        """The same on one rank, stored entry by entry, with the arrays of a matrix of DOLFINx.

        DOLFINx assembles into its own matrix as fast as into one in blocks, which a factorisation
        would have to copy.  With jumps the matrix is PETSc's own.
        """
        if self._jumps:
            return self.create_matrix()
        shared = fem.create_matrix(self._forms[0], block_mode=la.BlockMode.expanded)
        starts, columns = (part.astype(PETSc.IntType) for part in (shared.indptr, shared.indices))
        size, components = len(starts) - 1, self._forms[0].function_spaces[0].dofmap.index_map_bs
        matrix = PETSc.Mat().createAIJWithArrays(
            (size, size), (starts, columns, shared.data), comm=PETSc.COMM_SELF
        )
        matrix.setBlockSize(components)
        matrix.setAttr(_SHARED, shared)
        return matrix

    def assemble_vector(self, vector: la.Vector) -> None:
        """Set the owned values of a vector of the displacements to the linear form; collective."""
        vector.array[:] = 0.0
        for form in self._forms:
            fem.assemble_vector(vector.array, form)
        vector.scatter_reverse(la.InsertMode.add)
        for item in self._jumps:
            vector.array[:] += item.forces()

    def assemble_matrix(self, matrix: PETSc.Mat, conditions: Sequence[fem.DirichletBC]) -> None:
        """Set a matrix, with the identity at the conditions of displacements; collective."""
        matrix.zeroEntries()
        shared = matrix.getAttr(_SHARED)
        for number, (part, form) in enumerate(zip(self._parts, self._forms, strict=True)):
            space, fixed = _space(part), list(conditions)
            if number > 0:
                if space != _space(self._parts[0]):
                    fixed = _fixed(space, conditions)
                # The identity was inserted last, and now values are added.
                matrix.assemble(PETSc.Mat.AssemblyType.FLUSH)
            if shared is None:
                petsc.assemble_matrix(matrix, form, bcs=fixed)
            else:
                fem.assemble_matrix(shared, form, fixed)
        matrix.assemble()
        for item in self._jumps:
            stiffness = item.stiffness(conditions)
            stiffness.convert(matrix.getType())
            matrix.axpy(1.0, stiffness, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            stiffness.destroy()


class _FormOfJump:
    """One part of a form, with a jump as its arguments, as a form of displacements."""

    def __init__(
        self, jump: JumpValues, part: ufl.Form, compile_form: Callable[[ufl.Form], fem.Form]
    ) -> None:
        self._jump, self._form = jump, compile_form(part)
        self._vector = fem.Function(jump.space)

    def forces(self) -> FloatArray:
        """The linear form at all local dofs of displacements; collective."""
        jump, vector = self._jump, self._vector.x
        jump.refresh()
        vector.array[:] = 0.0
        fem.assemble_vector(vector.array, self._form)
        vector.scatter_reverse(la.InsertMode.add)
        return jump.carried(vector.array)

    def stiffness(self, conditions: Sequence[fem.DirichletBC] | None) -> PETSc.Mat:
        """The bilinear form without what conditions fix; collective.

        Without ``conditions`` it has all entries that there may be.
        """
        self._jump.refresh()
        matrix = petsc.assemble_matrix(self._form)
        matrix.assemble()
        free = np.ones(len(self._vector.x.array))
        for condition in conditions or ():
            free[condition.dof_indices()[0]] = 0.0
        jump = self._jump.square(free)
        stiffness = matrix.PtAP(jump)
        for item in (matrix, jump):
            item.destroy()
        return stiffness


def _space(part: ufl.Form) -> fem.FunctionSpace:
    return part.arguments()[0].ufl_function_space()


def _fixed(
    space: fem.FunctionSpace, conditions: Sequence[fem.DirichletBC]
) -> list[fem.DirichletBC]:
    """Conditions that fix the same degrees of freedom of another space."""
    every = [np.empty(0, dtype=np.int32), *(item.dof_indices()[0] for item in conditions)]
    dofs, zero, dim = np.unique(np.concatenate(every)), fem.Function(space), space.dofmap.bs
    parts = [dofs[dofs % dim == i] for i in range(dim)]
    return [fem.dirichletbc(zero, [part, part], space.sub(i)) for i, part in enumerate(parts)]
