"""Forms whose integrals are compiled apart, and assembled together.

For each cell and facet of a form DOLFINx stores all coefficients of the form.  Cells and facets
have forms of their own, so that no cell stores coefficients of facets.

FFCx 0.9 treats values at the only point of a quadrature rule as constant in the cell, and
uses that in the other rules of the same form, too.  So integrals that evaluate the coordinates in
one point, as all of an axisymmetric body do with linear displacements, have forms of their own.
The same of arguments loses a traction, in one point of a facet, beside the nodes of a contact
there: the rules of facets have forms of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import ufl
from dolfinx import fem, la
from dolfinx.fem import petsc
from petsc4py import PETSc

from contact_locking.fem import compiled
from contact_locking.fem.contact_operator import ContactOperator

# By this name a PETSc matrix keeps the matrix of DOLFINx whose arrays it shares.
_SHARED = "shared_with_dolfinx"


def compiled_together(form: ufl.Form) -> list[ufl.Form]:
    """The integrals of a form, in forms that can be compiled together, those of cells first.

    These are one form for the cells and one for each quadrature rule of the facets, or two if some
    integrals evaluate the coordinates in one point; and one for each object of mesh tags, of which
    DOLFINx takes one for all integrals of a form.
    """
    groups: dict[Any, list[Any]] = {}
    for integral in form.integrals():
        kind, tags = integral.integral_type(), id(integral.subdomain_data())
        rule = None if kind == "cell" else integral.metadata().get("quadrature_rule")
        key = kind, rule, _is_at_one_point(integral), tags
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


class JointForm:
    """A compiled form, in the parts of :func:`compiled_together`.

    ``compile_form`` compiles each part.
    """

    def __init__(
        self, form: ufl.Form, compile_form: Callable[[ufl.Form], fem.Form] = compiled.form
    ) -> None:
        self._forms = [compile_form(part) for part in compiled_together(form)]

    def create_matrix(
        self, operators: Sequence[ContactOperator] = (), kind: str | None = None
    ) -> PETSc.Mat:
        """A matrix with the entries of the cells' integrals and of ``operators``; collective."""
        others = [item for item in operators if item.couples_cells]
        if not others:
            return petsc.create_matrix(self._forms[0], kind)
        matrix = petsc.create_matrix(self._forms[0])
        # PETSc forgets the places of entries that nobody has given a value.
        petsc.assemble_matrix(matrix, self._forms[0])
        matrix.assemble()
        numbering = matrix.getLGMap()
        for item in others:
            pattern = item.pattern(matrix)
            matrix.axpy(1.0, pattern, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            pattern.destroy()
        if kind is not None:
            matrix.convert(kind)
        matrix.setLGMap(*numbering)
        return matrix

    def create_shared_matrix(self, operators: Sequence[ContactOperator] = ()) -> PETSc.Mat:
        """The same on one rank, stored entry by entry, with the arrays of a matrix of DOLFINx.

        DOLFINx assembles into its own matrix as fast as into one in blocks, which a factorisation
        would have to copy.  With entries that couple cells the matrix is PETSc's own.
        """
        if any(item.couples_cells for item in operators):
            return self.create_matrix(operators)
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

    def assemble_matrix(self, matrix: PETSc.Mat, conditions: Sequence[fem.DirichletBC]) -> None:
        """Set a matrix, with the identity at the conditions of displacements; collective."""
        matrix.zeroEntries()
        shared = matrix.getAttr(_SHARED)
        for number, form in enumerate(self._forms):
            if number > 0:
                # The identity was inserted last, and now values are added.
                matrix.assemble(PETSc.Mat.AssemblyType.FLUSH)
            if shared is None:
                petsc.assemble_matrix(matrix, form, bcs=list(conditions))
            else:
                fem.assemble_matrix(shared, form, list(conditions))
        matrix.assemble()
