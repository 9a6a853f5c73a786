"""The stress with the least complementary energy, by hybridisation.

On each triangle the stresses have the given divergence exactly.  Lagrange multipliers on the facets
make the traction continuous and give it the prescribed values on the boundary:

    sum_K N_K H_K^-1 N_K^T L = t - sum_K (n_K + N_K H_K^-1 r_K),

where H_K is the matrix of ``int C s : s``, and N_K maps the coefficients of the divergence-free
stresses of K to the moments of their tractions.  The matrix is symmetric and positive definite.

Where the strain of the body is limited, a force T along the facets of the boundary, as of bars in
them, carries loads beside the stress s, ``s nu = g + T' t`` on Gamma_N, at the cost ``int M |T|``
(docs/certificate.md).  The forces of bars that meet are in balance, or a support takes them, which
adds unknowns at the vertices.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import basix
import numpy as np
from dolfinx import la
from petsc4py import PETSc

from contact_locking.arrays import BoolArray, FloatArray, flattened
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.errors import raise_callback_error
from contact_locking.mesh.rank_sums import marked, summed
from contact_locking.parallel import maximum
from contact_locking.solver.linear.ksp import create_ksp, default_options, destroy_ksp
from contact_locking.theory.guaranteed.triangles import (
    FACETS,
    TENSORS,
    MacroElement,
    Triangles,
    legendre,
)

# Directions that differ by less do so by rounding.
_ROUNDING = 1e-10
# Each facet is divided into so many pieces, and zeta is constant in each.
_PIECES = 2


class Bars:
    """Bars in the m facets of the boundary where ``limit`` (n,) is finite, or none; collective.

    The force is a polynomial of degree k + 1 along the direction of the facet that all ranks share.
    Its k + 2 coefficients are the values at both ends, and those of the bubbles ``s (1 - s) P_j``.
    ``held`` (n, 3, 2) marks the components that are prescribed on a facet.

    ``cells`` (m,) and ``sides`` (m,) say which side of which triangle each facet is.  ``tied``
    (m, 2) marks the ends where the force is that of the next bar of a straight part of the
    boundary, ``vertices`` (m, 2) are the local numbers of the ends.  At other ends the force is
    zero, unless a support takes it.  ``constraints`` (m, 3 b, k + 2) are the shares of the forces
    in the balance of the facet and of its ends, for b = 2 (k + 1): first b moments on the facet;
    the first row of each of the next two blocks is the force at a tied end.
    """

    def __init__(
        self, triangles: Triangles, degree: int, held: BoolArray, limit: FloatArray | None = None
    ) -> None:
        limit = np.full(len(triangles.areas), np.inf) if limit is None else limit
        self.degree = degree
        bare = triangles.outside & ~held.all(axis=2) & np.isfinite(limit)[:, None]
        self.cells, self.sides = cells, sides = np.nonzero(bare)
        self._turned = triangles.signs[cells, sides] < 0.0
        ends = self._directed(triangles.ends[cells, sides])
        self.lengths = triangles.lengths[cells, sides]
        self._tangents = (ends[:, 1] - ends[:, 0]) / self.lengths[:, None]
        self._limit = limit[cells]
        self.vertices = self._directed(triangles.vertices[cells[:, None], FACETS[sides]])
        self._meet(triangles, held)
        self._integrate()
        self.constraints = self._constraints(held[cells, sides])

    def along(self, strains: FloatArray) -> FloatArray:
        """``d_s w_t`` (m, 2) at both ends, from strains (n, 3, p, 3) at the points of the parts."""
        # The first points of a part are the ends of its facet.
        at_ends = self._directed(strains[self.cells, self.sides, :2])
        stretched = np.einsum("mi,aij,mj->ma", self._tangents, TENSORS, self._tangents)
        return np.einsum("mea,ma->me", at_ends, stretched)

    def best_stiffening(self, forces: FloatArray) -> FloatArray:
        """The zeta (m, 2) that minimises ``T^2/zeta + zeta M^2`` in each half of the facets."""
        return np.sqrt(_PIECES * self._squares(forces)) / self._limit[:, None]

    def solved(self, zeta: FloatArray, along: FloatArray) -> FloatArray:
        """(m, k + 2, 1 + 3 b) the forces that ``along`` (m, 2) and unit multipliers cause.

        They minimise ``int T^2/2 zeta - T d_s w_t`` with the share of the multipliers of
        ``constraints``.
        """
        matrix = np.einsum("mr,rab->mab", self.lengths[:, None] / zeta, self._masses)
        right = np.concatenate(
            [self._work(along)[:, :, None], np.swapaxes(self.constraints, 1, 2)], axis=2
        )
        bars, shapes = np.nonzero(self._zero)
        matrix[bars, shapes] = matrix[bars, :, shapes] = 0.0
        matrix[bars, shapes, shapes] = 1.0
        right[bars, shapes, 0] = 0.0
        return np.linalg.solve(matrix, right)

    def gap(self, forces: FloatArray, along: FloatArray) -> FloatArray:
        """``int M |T| - T d_s w_t`` (m,), from above.

        For the share by which w exceeds M, M is enlarged, as in the cells.
        """
        stretched = np.einsum("ma,rab,mb->mr", along, self._affine_masses, along)
        most = np.maximum(self._limit[:, None] ** 2 / _PIECES, stretched)
        size = np.sum(np.sqrt(self._squares(forces) * most), axis=1)
        return np.asarray(self.lengths * size - self.work(forces, along))

    def work(self, forces: FloatArray, along: FloatArray) -> FloatArray:
        """``int T d_s w_t`` (m,) over the facets."""
        return np.einsum("ma,ma->m", forces, self._work(along))

    def _directed(self, pairs: Any) -> Any:
        """Values (m, 2, ...) at the ends in the order that all ranks share."""
        found = pairs.copy()
        found[self._turned] = pairs[self._turned][:, ::-1]
        return found

    def _meet(self, triangles: Triangles, held: BoolArray) -> None:
        """Find the ends that are tied, those without a force, and the signs of the tied ones."""
        marks = np.repeat(held[:, :, None], 2, axis=2).astype(float)
        at_vertices = partial(summed, triangles.vertex_map)
        holds = at_vertices(triangles.vertices[:, FACETS], marks)[self.vertices] > 0.5
        # The double angle belongs to a direction without a sign.
        t = self._tangents
        double = np.column_stack([t[:, 0] ** 2 - t[:, 1] ** 2, 2.0 * t[:, 0] * t[:, 1]])
        mean = at_vertices(self.vertices, np.repeat(double[:, None], 2, axis=1))[self.vertices]
        angle = 0.5 * np.arctan2(mean[..., 1], mean[..., 0])
        common = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        apart = np.abs(t[:, None, 0] * common[..., 1] - t[:, None, 1] * common[..., 0])
        straight = at_vertices(self.vertices, apart[..., None])[self.vertices, 0] <= _ROUNDING
        taken = np.all(holds | (np.abs(t)[:, None] <= _ROUNDING), axis=2)
        self.tied: BoolArray = straight & ~taken
        self._zero = np.zeros((len(t), self.degree + 2), dtype=bool)
        self._zero[:, :2] = ~straight & ~taken
        # A bar pulls its first end forwards and its last end backwards.
        pulls = np.sign(np.einsum("mi,mei->me", t, common)) * [-1.0, 1.0]
        self._signs = np.where(self.tied, pulls, 0.0)

    def _constraints(self, held: BoolArray) -> FloatArray:
        block = 2 * (self.degree + 1)
        found = np.zeros((len(held), 3, block, self.degree + 2))
        rises = -self._tangents[:, None, :, None] * self._rises[:, None]
        found[:, 0] = np.where(held[:, None, :, None], 0.0, rises).reshape(found[:, 0].shape)
        found[:, [1, 2], 0, [0, 1]] = self._signs
        rows = found.reshape(len(held), 3 * block, self.degree + 2)
        return np.where(self._zero[:, None], 0.0, rows)

    def _integrate(self) -> None:
        """Integrals over a facet of length 1."""
        k = self.degree
        points, weights = basix.make_quadrature(basix.CellType.interval, 2 * k + 2)
        halves = (np.arange(_PIECES)[:, None] + points[:, 0]) / _PIECES
        shapes = _shapes(k, halves.reshape(-1)).reshape(_PIECES, -1, k + 2)
        affine = _shapes(0, halves.reshape(-1)).reshape(_PIECES, -1, 2)
        shares = weights / _PIECES
        self._masses = np.einsum("q,rqa,rqb->rab", shares, shapes, shapes)
        self._affine_masses = np.einsum("q,rqa,rqb->rab", shares, affine, affine)
        self._mixed = np.einsum("q,rqa,rqe->ae", shares, shapes, affine)
        # By parts, int P_j T' = [P_j T] - int P_j' T.
        slopes = np.polynomial.legendre.legder(np.eye(k + 1) * np.sqrt(2 * np.arange(k + 1) + 1.0))
        rates = 2.0 * np.polynomial.legendre.legval(2.0 * halves - 1.0, slopes)
        self._rises = -np.einsum("q,jrq,rqa->ja", shares, rates, shapes)
        self._rises[:, :2] += legendre(k, np.array([0.0, 1.0])).T * [-1.0, 1.0]

    def _work(self, along: FloatArray) -> FloatArray:
        """``int f_a d_s w_t`` (m, k + 2), for the shapes f_a of the force."""
        return np.asarray(self.lengths[:, None] * (along @ self._mixed.T))

    def _squares(self, forces: FloatArray) -> FloatArray:
        """``int T^2`` over each piece (m, r) of a facet of length 1."""
        return np.einsum("ma,rab,mb->mr", forces, self._masses, forces)


def _shapes(degree: int, s: FloatArray) -> FloatArray:
    """The shapes (q, k + 2) of forces of degree k + 1 at points s (q,)."""
    ends = np.column_stack([1.0 - s, s])
    if degree == 0:
        return ends
    return np.column_stack([ends, (s * (1.0 - s))[:, None] * legendre(degree - 1, s)])


# A prefix of its own: the options for the nonlinear solve do not concern these solves.
_PREFIX = "contact_locking_stress_"
_RTOL = 1e-12
#: The largest relative jump of tractions that counts as rounding.
LARGEST_JUMP = 1e-8


@dataclass(frozen=True)
class Forces:
    """The forces that the stresses of n triangles balance.

    ``held`` (n, 3, 2) marks the components with prescribed displacements, where the traction is
    free.  ``body`` (n, 3, l, 2) is the body force, and ``moments`` (n, 3, k + 1, 2) are the moments
    of the prescribed tractions along the directions that all ranks give to the facets.  ``springs``
    (n, 3, b, b), for blocks of b = 2 (k + 1) multipliers, fix the rigid motions that no
    displacement condition holds.
    """

    held: BoolArray
    body: FloatArray
    moments: FloatArray
    springs: FloatArray


class HybridSystem:
    """The hybrid system of a mesh with given forces; collective.

    :meth:`solve` may be called for several compliances.
    """

    def __init__(
        self, triangles: Triangles, element: MacroElement, forces: Forces, bars: Bars, linear: str
    ) -> None:
        self._triangles, self._element, self._bars = triangles, element, bars
        self._springs, self._linear = forces.springs, linear
        powers, maps, n = np.arange(element.degree + 1), triangles.maps, len(triangles.areas)
        # Of a reference traction: the factor |F| of the traction, and the direction of the facet.
        factors = triangles.signs[:, :, None] ** powers * 2.0 * triangles.areas[:, None, None]
        held = np.repeat(forces.held[:, :, None], len(powers), axis=2)
        basis = np.einsum("nij,cfkj->nfkic", maps, element.moments, optimize=True)
        tractions = np.where(held[..., None], 0.0, basis * factors[..., None, None])
        self._block = 2 * len(powers)
        self._tractions = tractions.reshape(n, 3 * self._block, len(element.basis))
        self._held = flattened(held)
        # s = F r F^T has the divergence F div r.
        wanted = flattened(np.einsum("nij,ntlj->ntli", np.linalg.inv(maps), -forces.body))
        lifted = wanted @ element.lifts.reshape(wanted.shape[1], -1)
        self._lifted = triangles.moved(lifted.reshape(n, *element.basis.shape[1:]))
        lifted = wanted @ element.lift_moments.reshape(wanted.shape[1], -1)
        lifted = np.einsum("nij,nfkj->nfki", maps, lifted.reshape(n, *element.moments.shape[1:]))
        self._of_lift = flattened(lifted * factors[..., None])
        self._wanted = flattened(forces.moments)
        self._number()

    def solve(
        self, compliance: FloatArray, strains: FloatArray, stiffening: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """The stress s that minimises ``int C s : s/2 - eps : s``, with forces of bars; collective.

        ``compliance`` (n, 3, 4, 3, 3) is C in the quarters of each part, as a Mandel matrix, and
        ``strains`` (n, 3, m, 3) is eps.  ``stiffening`` (b, 2) is zeta of the bars.  Returns s (n,
        3, m, 3), the forces (b, k + 2), and what is left of the balance of the moments, relative to
        the largest moment.  Raises NotApplicable if the linear solver fails.
        """
        element, triangles, bars = self._element, self._triangles, self._bars
        areas, count = triangles.areas / 3.0, len(element.basis)
        pull = element.mass @ strains
        for share, part in zip(element.quarters, np.moveaxis(compliance, 2, 0), strict=True):
            pull -= share @ self._lifted @ part
        pull = (flattened(pull, kept=1) @ triangles.transforms) * areas[:, None, None]
        forces = flattened(pull) @ element.basis.reshape(count, -1).T
        right = np.concatenate([forces[:, :, None], np.swapaxes(self._tractions, 1, 2)], axis=2)
        solved = np.linalg.solve(self._stiffness(compliance), right)
        local = self._tractions @ solved
        given = self._wanted - self._of_lift - local[:, :, 0]
        given[self._held] = 0.0
        stretched = bars.solved(stiffening, bars.along(strains))
        pulled = bars.constraints @ stretched
        matrices = local[:, :, 1:], pulled[:, :, 1:]
        at_cells, at_bars = self._multipliers(*matrices, given, -pulled[:, :, 0])
        coefficients = solved[:, :, 0] + np.einsum("ncb,nb->nc", solved[:, :, 1:], at_cells)
        tension = stretched[:, :, 0] + np.einsum("mcb,mb->mc", stretched[:, :, 1:], at_bars)
        moments = self._of_lift + np.einsum("nbc,nc->nb", self._tractions, coefficients)
        jump = self._jump(moments, np.einsum("mbc,mc->mb", bars.constraints, tension))
        stress = (coefficients @ element.basis.reshape(count, -1)).reshape(strains.shape)
        return self._lifted + triangles.moved(stress), tension, jump

    def _stiffness(self, compliance: FloatArray) -> FloatArray:
        """``H_K = |K|/3 sum_tsab (P^T C P)_tsab G_tsab`` over the quarters s of the parts t."""
        element, count = self._element, len(self._element.basis)
        transforms = self._triangles.transforms[:, None, None]
        gram = np.einsum("itpa,spq,jtqb->tsabij", element.basis, element.quarters, element.basis)
        inner = np.swapaxes(transforms, 3, 4) @ compliance @ transforms
        inner *= self._triangles.areas[:, None, None, None, None] / 3.0
        return (flattened(inner) @ gram.reshape(-1, count**2)).reshape(-1, count, count)

    def _number(self) -> None:
        """Number the blocks of unknowns: on each rank those of facets before those of vertices."""
        comm, bars, triangles = self._triangles.domain.comm, self._bars, self._triangles
        facets, vertices = triangles.facet_map, triangles.vertex_map
        tied = np.flatnonzero(marked(vertices, bars.vertices[bars.tied]))
        mine, others = tied[tied < vertices.size_local], tied[tied >= vertices.size_local]
        first, self._of_vertices = facets.size_local, len(mine)
        self._owned = first + len(mine)
        start = comm.exscan(self._owned) or 0
        at_facets, at_vertices = la.vector(facets, 1), la.vector(vertices, 1)
        at_facets.array[:first] = start + np.arange(first)
        at_vertices.array[mine] = start + np.arange(first, self._owned)
        for numbers in (at_facets, at_vertices):
            numbers.scatter_forward()
        ghosts = np.concatenate([at_facets.array[first:], at_vertices.array[others]])
        self._ghosts = ghosts.astype(PETSc.IntType)
        # On each rank the ghosts come last.
        of_facets = np.arange(len(at_facets.array), dtype=PETSc.IntType)
        of_facets[first:] += len(mine)
        of_vertices = np.zeros(len(at_vertices.array), dtype=PETSc.IntType)
        of_vertices[mine] = np.arange(first, self._owned)
        of_vertices[others] = len(of_facets) + len(mine) + np.arange(len(others))
        self._of_cells = of_facets[triangles.facets]
        # Ends that are not tied have no entries; they take the place of the facet.
        here = of_facets[triangles.facets[bars.cells, bars.sides]]
        ends = np.where(bars.tied, of_vertices[bars.vertices], here[:, None])
        self._of_bars = np.column_stack([here, ends])
        blocks = np.concatenate([self._of_cells, self._of_bars])
        self._places = (blocks[:, :, None] * self._block + np.arange(self._block)).reshape(-1)

    def _vector(self) -> PETSc.Vec:
        """A vector of the unknowns with ghosts; collective."""
        comm, size = self._triangles.domain.comm, (self._owned * self._block, None)
        return PETSc.Vec().createGhost(self._ghosts, size, self._block, comm)

    def _multipliers(
        self, blocks: FloatArray, of_bars: FloatArray, given: FloatArray, at_bars: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The multipliers (n, 3 b) of the triangles and (m, 3 b) of the bars; collective.

        ``given`` and ``at_bars`` are the right-hand sides, of the same shapes.
        """
        b, x = self._vector(), self._vector()
        matrix = self._matrix(b, blocks, of_bars)
        comm = self._triangles.domain.comm
        options = default_options(self._linear, 2, matrix.getSize()[0], comm)
        ksp = create_ksp(comm, options | {"ksp_rtol": _RTOL}, prefix=_PREFIX)
        try:
            ksp.setOperators(matrix)
            self._sum(b, given, at_bars)
            ksp.solve(b, x)
            x.ghostUpdate(PETSc.InsertMode.INSERT, PETSc.ScatterMode.FORWARD)
            with x.localForm() as local:
                found = local.array_r[self._places].reshape(-1, 3 * self._block)
            return found[: len(given)], found[len(given) :]
        except PETSc.Error as error:
            raise_callback_error(error)
            raise NotApplicable("the linear solve for the stress failed") from error
        finally:
            destroy_ksp(ksp)
            for item in (b, x, matrix):
                item.destroy()

    def _matrix(self, vector: PETSc.Vec, blocks: FloatArray, of_bars: FloatArray) -> PETSc.Mat:
        """The matrix from its blocks (n, 3 b, 3 b) and (m, 3 b, 3 b); collective."""
        size, add = self._block, PETSc.InsertMode.ADD_VALUES
        values = np.array(blocks)
        for facet in range(3):
            place = slice(facet * size, (facet + 1) * size)
            values[:, place, place] += self._springs[:, facet]
        cells, rows = np.nonzero(self._held)
        values[cells, rows, rows] = 1.0
        matrix = PETSc.Mat().create(vector.getComm())
        matrix.setSizes((vector.getSizes(),) * 2, bsize=size)
        matrix.setType(PETSc.Mat.Type.AIJ)
        # A facet is coupled to itself and to four others: of its triangles, or of bars.
        matrix.setPreallocationNNZ((5 * size, 4 * size))
        matrix.setLGMap(vector.getLGMap())
        matrix.setValuesBlockedLocalRCV(self._of_cells, self._of_cells, values, addv=add)
        matrix.setValuesBlockedLocalRCV(self._of_bars, self._of_bars, of_bars, addv=add)
        # A vertex has one unknown of a block.
        start, end = vector.getOwnershipRange()
        for row in range(end - self._of_vertices * size, end):
            if (row - start) % size:
                matrix.setValue(row, row, 1.0, addv=add)
        matrix.assemble()
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        return matrix

    def _sum(self, vector: PETSc.Vec, values: FloatArray, of_bars: FloatArray) -> None:
        """Set a vector to the sums of values (n, 3 b) and (m, 3 b) at the unknowns; collective."""
        every = np.concatenate([values, of_bars]).reshape(-1)
        with vector.localForm() as local:
            local.array_w[:] = np.bincount(self._places, every, local.getSize())
        vector.ghostUpdate(PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)

    def _jump(self, moments: FloatArray, of_bars: FloatArray) -> float:
        """What is left of the balance of the moments, over the largest moment; collective."""
        sums = self._vector()
        self._sum(sums, np.where(self._held, 0.0, moments - self._wanted), of_bars)
        jump = float(sums.norm(PETSc.NormType.INFINITY))
        sums.destroy()
        largest = maximum(self._triangles.domain.comm, np.abs(moments))
        return jump / largest if largest > 0.0 else 0.0
