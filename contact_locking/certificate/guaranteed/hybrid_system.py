"""The stress with the least complementary energy, by hybridisation.

On each triangle the stresses have the given divergence exactly.  Lagrange multipliers on the facets
make the traction continuous and give it the prescribed values on the boundary:

    sum_K N_K H_K^-1 N_K^T L = t - sum_K (n_K + N_K H_K^-1 r_K),

where H_K is the matrix of ``int C s : s``, and N_K maps the coefficients of the divergence-free
stresses of K to the moments of their tractions.  The matrix is symmetric and positive definite.
Bars in the boundary add unknowns at the vertices that balance the forces of bars that meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from dolfinx import la
from petsc4py import PETSc

from contact_locking.arrays import BoolArray, FloatArray, flattened
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.certificate.guaranteed.bars import Bars
from contact_locking.certificate.guaranteed.macro_element import MacroElement
from contact_locking.certificate.guaranteed.triangles import Triangles
from contact_locking.errors import raise_callback_error
from contact_locking.mesh.rank_sums import marked, summed
from contact_locking.solver.linear.ksp import create_ksp, default_options, destroy_ksp

# A prefix of its own: the options for the nonlinear solve do not concern these solves.
_PREFIX = "contact_locking_stress_"
_RTOL = 1e-12
#: The largest relative jump of tractions that counts as rounding.
LARGEST_JUMP = 1e-8


@dataclass(frozen=True)
class Boundary:
    """The conditions for the tractions on the facets of each triangle.

    ``held`` (n, 3, 2) marks the components with prescribed displacements, where the traction is
    free.  ``moments`` (n, 3, k + 1, 2) are the moments of the prescribed tractions.  ``springs``
    (n, 3, b, b), for blocks of b = 2 (k + 1) multipliers, fix the rigid motions that no
    displacement condition holds, and are zero elsewhere.
    """

    held: BoolArray
    moments: FloatArray
    springs: FloatArray | None = None


@dataclass(frozen=True)
class Found:
    """The divergence-free part ``stress`` (n, 3, m, 3), and the ``forces`` (b, k + 2) of the bars.

    ``jump`` is what is left of the balance of the moments, relative to the largest moment.
    """

    stress: FloatArray
    forces: FloatArray
    jump: float


class HybridSystem:
    """The hybrid system of a mesh with given conditions on the boundary; collective.

    :meth:`solve` may be called for several compliances.
    """

    def __init__(
        self,
        triangles: Triangles,
        element: MacroElement,
        boundary: Boundary,
        bars: Bars,
        linear: str,
    ) -> None:
        self.triangles, self.element, self.boundary = triangles, element, boundary
        self.bars, self._linear = bars, linear
        maps, sizes = triangles.maps, triangles.determinants
        signs = triangles.signs[:, :, None] ** np.arange(element.degree + 1)
        #: Of a reference traction: the factor |F| of the traction, and the direction of the facet.
        self._weights = signs * sizes[:, None, None]
        block = 2 * (element.degree + 1)
        count = len(element.basis)
        # (n, i, f, k, c): the component i of the moment k on the facet f of the basis stress c.
        table = np.moveaxis(element.moments, (3, 0), (0, 3)).reshape(2, -1)
        moved = (maps.reshape(-1, 2) @ table).reshape(-1, 2, 3, element.degree + 1, count)
        tractions = np.moveaxis(moved, 1, 3) * self._weights[:, :, :, None, None]
        held = np.repeat(boundary.held[:, :, None, :], element.degree + 1, axis=2)
        tractions[held] = 0.0
        self._tractions = tractions.reshape(-1, 3 * block, count)
        self._held = held.reshape(-1, 3, block)
        self._block = block
        self._number()

    def moments(self, reference: FloatArray) -> FloatArray:
        """The moments (n, 3, k + 1, 2) of tractions from those (n, 3, k + 1, 2) in the reference.

        The moments are those along the direction that all ranks give to the facets.
        """
        moved = np.einsum("nij,nfkj->nfki", self.triangles.maps, reference)
        return np.asarray(moved * self._weights[:, :, :, None])

    def solve(
        self,
        compliance: FloatArray,
        strains: FloatArray,
        lifted: FloatArray,
        moments: FloatArray,
        stiffening: FloatArray,
    ) -> Found:
        """The stress that minimises ``int C s : s/2 - eps : s``, with forces of bars; collective.

        ``compliance`` (n, 3, 4, 3, 3) is C in the quarters of each part, as a Mandel matrix, and
        ``strains`` (n, 3, m, 3) is eps.  ``lifted`` (n, 3, m, 3) is the part of s that has the
        divergence, with the moments ``moments`` (n, 3, k + 1, 2).  ``stiffening`` (b, 2) is zeta of
        the bars.  Raises NotApplicable if the linear solver fails.
        """
        element, triangles, bars = self.element, self.triangles, self.bars
        areas = triangles.areas / 3.0
        size, count = len(areas), len(element.basis)
        stiffness = self._stiffness(compliance)
        pull = element.mass @ strains
        for share, part in zip(element.quarters, np.moveaxis(compliance, 2, 0), strict=True):
            pull -= share @ lifted @ part
        pull = (flattened(pull, kept=1) @ triangles.transforms) * areas[:, None, None]
        forces = flattened(pull) @ element.basis.reshape(count, -1).T
        right = np.concatenate([forces[:, :, None], np.swapaxes(self._tractions, 1, 2)], axis=2)
        solved = np.linalg.solve(stiffness, right)
        local = self._tractions @ solved
        given = flattened(self.boundary.moments) - flattened(moments) - local[:, :, 0]
        given[flattened(self._held)] = 0.0
        along = bars.along(strains)
        stretched = bars.solved(stiffening, along)
        pulled = bars.constraints @ stretched
        with self._factored(local[:, :, 1:], pulled[:, :, 1:]) as multipliers:
            at_cells, at_bars = multipliers(given, -pulled[:, :, 0])
        coefficients = solved[:, :, 0] + (solved[:, :, 1:] @ at_cells[:, :, None])[:, :, 0]
        tension = stretched[:, :, 0] + (stretched[:, :, 1:] @ at_bars[:, :, None])[:, :, 0]
        found = flattened(moments) + (self._tractions @ coefficients[:, :, None])[:, :, 0]
        jump = self._jump(found, (bars.constraints @ tension[:, :, None])[:, :, 0])
        stress = coefficients @ element.basis.reshape(count, -1)
        return Found(triangles.moved(stress.reshape(size, *strains.shape[1:])), tension, jump)

    @contextmanager
    def traces(self, compliance: FloatArray) -> Iterator[Callable[[FloatArray], FloatArray]]:
        """A function from prescribed moments m to L (n, 3, k + 1, 2), with no bars; collective.

        L are the multipliers of the stress s without divergence that has the moments and minimises
        ``int C s : s``.  This integral is the sum of L m, and L is the trace of a displacement, of
        which C s is the strain, weakly.
        """
        stiffness, none = self._stiffness(compliance), np.zeros((0, 3 * self._block))
        local = self._tractions @ np.linalg.solve(stiffness, np.swapaxes(self._tractions, 1, 2))
        with self._factored(local, np.zeros((0, *local.shape[1:]))) as multipliers:

            def apply(moments: FloatArray) -> FloatArray:
                given = np.where(self._held, 0.0, moments.reshape(self._held.shape))
                found = multipliers(flattened(given), none)[0]
                return found.reshape(moments.shape)

            yield apply

    def _stiffness(self, compliance: FloatArray) -> FloatArray:
        """``H_K = |K|/3 sum_tsab (P^T C P)_tsab G_tsab`` over the quarters s of the parts t."""
        element, count = self.element, len(self.element.basis)
        transforms = self.triangles.transforms[:, None, None]
        gram = np.einsum("itpa,spq,jtqb->tsabij", element.basis, element.quarters, element.basis)
        inner = np.swapaxes(transforms, 3, 4) @ compliance @ transforms
        inner *= self.triangles.areas[:, None, None, None, None] / 3.0
        return (flattened(inner) @ gram.reshape(-1, count**2)).reshape(-1, count, count)

    def _number(self) -> None:
        """Number the blocks of unknowns: on each rank those of facets before those of vertices."""
        comm, facets = self.triangles.domain.comm, self.triangles.facet_map
        bars = self.bars
        tied = marked(bars.vertex_map, bars.vertices[bars.tied])
        self._vertices = np.nonzero(tied[: bars.vertex_map.size_local])[0]
        owned = facets.size_local + len(self._vertices)
        first = comm.exscan(owned) or 0
        numbers = la.vector(facets, 1)
        numbers.array[: facets.size_local] = first + np.arange(facets.size_local)
        numbers.scatter_forward()
        at_vertices = la.vector(bars.vertex_map, 1)
        at_vertices.array[self._vertices] = (
            first + facets.size_local + np.arange(len(self._vertices))
        )
        at_vertices.scatter_forward()
        self._blocks = owned, comm.allreduce(owned)
        self._cell_blocks = numbers.array[self.triangles.facets].astype(PETSc.IntType)
        # Ends that are not tied have no entries; they take the place of the facet.
        at_bars = self.triangles.facets[bars.cells, bars.sides]
        here = numbers.array[at_bars]
        ends = np.where(bars.tied, at_vertices.array[bars.vertices], here[:, None])
        self._bar_blocks = np.column_stack([here, ends]).astype(PETSc.IntType)

    @contextmanager
    def _factored(
        self, blocks: FloatArray, bar_blocks: FloatArray
    ) -> Iterator[Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]]:
        """A function from what is given to the multipliers, which it factorises once; collective.

        Both are (n, 3 b) of the triangles and (m, 3 b) of the bars.
        """
        matrix = self._matrix(blocks, bar_blocks)
        comm = self.triangles.domain.comm
        b, x = matrix.createVecLeft(), matrix.createVecRight()
        options = default_options(self._linear, 2, matrix.getSize()[0], comm)
        ksp = create_ksp(comm, options | {"ksp_rtol": _RTOL}, prefix=_PREFIX)

        def solve(given: FloatArray, of_bars: FloatArray) -> tuple[FloatArray, FloatArray]:
            at_facets, at_vertices = self._summed(given, of_bars)
            b.array_w[:] = np.concatenate([at_facets.reshape(-1), at_vertices.reshape(-1)])
            ksp.solve(b, x)
            return self._spread(x.array_r.reshape(-1, self._block))

        try:
            ksp.setOperators(matrix)
            yield solve
        except PETSc.Error as error:
            raise_callback_error(error)
            raise NotApplicable("the linear solve for the stress failed") from error
        finally:
            destroy_ksp(ksp)
            for item in (b, x, matrix):
                item.destroy()

    def _matrix(self, blocks: FloatArray, of_bars: FloatArray) -> PETSc.Mat:
        """The matrix from its blocks (n, 3 b, 3 b) and (m, 3 b, 3 b); collective."""
        size, (owned, total) = self._block, self._blocks
        values = np.array(blocks).reshape(-1, 3 * size, 3 * size)
        if self.boundary.springs is not None:
            for facet in range(3):
                place = slice(facet * size, (facet + 1) * size)
                values[:, place, place] += self.boundary.springs[:, facet]
        cells, rows = np.nonzero(flattened(self._held))
        values[cells, rows, rows] = 1.0
        matrix = PETSc.Mat().create(self.triangles.domain.comm)
        matrix.setSizes(((owned * size, total * size),) * 2, bsize=size)
        matrix.setType(PETSc.Mat.Type.AIJ)
        # A facet is coupled to itself and to four others: of its triangles, or of bars.
        matrix.setPreallocationNNZ((5 * size, 4 * size))
        add = PETSc.InsertMode.ADD_VALUES
        matrix.setValuesBlockedRCV(self._cell_blocks, self._cell_blocks, values, addv=add)
        matrix.setValuesBlockedRCV(self._bar_blocks, self._bar_blocks, of_bars, addv=add)
        # A vertex has one unknown of a block.
        first = matrix.getOwnershipRange()[1] - len(self._vertices) * size
        alone = (first + np.arange(len(self._vertices) * size)).reshape(-1, size)[:, 1:]
        for row in alone.reshape(-1):
            matrix.setValue(row, row, 1.0, addv=add)
        matrix.assemble()
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        return matrix

    def _summed(self, values: FloatArray, of_bars: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The sums over triangles and bars at the owned facets (f, b) and vertices (v, b).

        ``values`` are (n, 3 b) and ``of_bars`` (m, 3 b).  Collective.
        """
        size, bars, facets = self._block, self.bars, self.triangles.facets
        ends = of_bars.reshape(-1, 3, size)
        places = np.concatenate([facets.reshape(-1), facets[bars.cells, bars.sides]])
        parts = np.concatenate([values.reshape(-1, size), ends[:, 0]])
        facet_map, tied = self.triangles.facet_map, bars.tied
        at_vertices = summed(bars.vertex_map, bars.vertices[tied], ends[:, 1:][tied])
        return summed(facet_map, places, parts)[: facet_map.size_local], at_vertices[self._vertices]

    def _spread(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The owned unknowns (f + v, b) at the triangles (n, 3 b) and at the bars (m, 3 b)."""
        size, bars, triangles = self._block, self.bars, self.triangles
        owned = triangles.facet_map.size_local
        of_facets, of_vertices = (
            la.vector(triangles.facet_map, size),
            la.vector(bars.vertex_map, size),
        )
        of_facets.array[: owned * size] = values[:owned].reshape(-1)
        of_vertices.array[:] = 0.0
        of_vertices.array.reshape(-1, size)[self._vertices] = values[owned:]
        of_facets.scatter_forward()
        of_vertices.scatter_forward()
        at_cells = of_facets.array.reshape(-1, size)[triangles.facets]
        at_ends = of_vertices.array.reshape(-1, size)[bars.vertices]
        at_bars = np.concatenate([at_cells[bars.cells, bars.sides][:, None], at_ends], axis=1)
        return flattened(at_cells), flattened(at_bars)

    def _jump(self, moments: FloatArray, of_bars: FloatArray) -> float:
        """The largest sum of moments and prescribed moments, over the largest moment."""
        comm = self.triangles.domain.comm
        given = flattened(self.boundary.moments)
        rest = np.where(flattened(self._held), 0.0, moments - given)
        sums = self._summed(rest, of_bars)
        local = [
            max(np.abs(part).max(initial=0.0) for part in sums),
            np.abs(moments).max(initial=0.0),
        ]
        jump, largest = np.max(comm.allgather(local), axis=0)
        return float(jump / largest) if largest > 0.0 else 0.0
