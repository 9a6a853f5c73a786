"""A direct solver on several ranks: each factorises its part, and a dense matrix joins them.

With the interiors of the parts, ``A_r``, and the separator G between them, a matrix is

    [ A_1        A_1G ]
    [       A_2  A_2G ]      S = A_GG - sum_r A_Gr A_r^-1 A_rG.
    [ A_G1  A_G2 A_GG ]

Rank r has CHOLMOD factorise ``A_r`` together with ``A_GG``.  The corner of that factor is
``L_r L_r^T = A_GG - A_Gr A_r^-1 A_rG``, so that the Schur complement S takes no solves; it is
factorised as a dense matrix, on every rank.  This is one step of nested dissection (George,
doi:10.1137/0710032), for few ranks, as the separator has to be small.

The reason for a solver of our own is its speed.  On two ranks a factorisation and six solves, the
work of one tangent, take PETSc's other solvers so many times as long.  The matrix is that of plain
elasticity on a unit block, in place of a tangent with locked cells (P1, PETSc 3.22; two shared
cores, the least of two to eight turns):

    unknowns          33 000 in 2D   132 000 in 2D   15 000 in 3D   41 000 in 3D
    MUMPS               1.7 to 1.9             1.6     1.4 to 1.7     1.6 to 1.8
    PCBDDC, CG to 1e-8        13.9             9.5            3.6

PCBDDC was measured beside an earlier version of this solver, which took about a tenth longer.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg import get_blas_funcs, lapack
from scipy.sparse.csgraph import breadth_first_order, maximum_bipartite_matching

from contact_locking.arrays import BoolArray, IndexArray
from contact_locking.solver.linear.direct.substructure import Numbers, Substructure, is_available
from contact_locking.solver.linear.options import PREFIX, InsertedOptions

_PREFIX = PREFIX + "separator_"


class Separator:
    """Its unknowns ``shared``, in ascending order, the same on every rank.

    ``interior`` are the unknowns of this rank's part without them; ``mine`` are the positions in
    ``shared`` of those that count to it, and ``touched`` of those that the interior has entries
    with, one at least.  No entry of the matrix is between two interiors.
    ``divides`` tells whether every rank has a part.
    Collective to make.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        comm, size = matrix.getComm().tompi4py(), matrix.getBlockSize()
        counts, neighbours = (np.concatenate(comm.allgather(a)) for a in _graph(matrix))
        # Scotch takes longer on several ranks, and has another result on each.
        parts = comm.bcast(_partition(counts, neighbours, comm.size) if comm.rank == 0 else None)
        nodes = np.repeat(np.arange(len(counts)), counts)
        # The ends of edges in the lower and in the higher of two parts.
        is_cut = parts[nodes] < parts[neighbours]
        separates = np.zeros(len(counts), dtype=bool)
        separates[least_cover(nodes[is_cut], neighbours[is_cut])] = True
        # A graph that is in parts already would need none.
        separates[0] |= not separates.any()
        # PETSc may have nothing that partitions.
        self.divides = len(np.unique(parts)) == comm.size
        is_mine = parts == comm.rank
        is_interior = is_mine & ~separates
        touches = np.zeros(len(counts), dtype=bool)
        touches[nodes[is_interior[neighbours]]] = True
        touches[np.argmax(separates)] |= not (touches & separates).any()
        self.shared = _unknowns(separates, size)
        self.interior = _unknowns(is_interior, size)
        self.mine = _unknowns(is_mine[separates], size)
        self.touched = _unknowns(touches[separates], size)


def least_cover(lower: IndexArray, higher: IndexArray) -> IndexArray:
    """The fewest nodes that contain an end of each edge; the edges have the ends given, (k,).

    They are as many as the edges of a largest matching (Koenig's theorem).  A node that is the
    lower end of some edges and the higher end of others counts as two nodes.
    """
    (lows, low), (highs, high) = (np.unique(ends, return_inverse=True) for ends in (lower, higher))
    shape = len(lows), len(highs)
    edges = _links(low, high, shape)
    partner = maximum_bipartite_matching(edges, perm_type="column")
    is_alone = partner < 0
    matched = np.flatnonzero(~is_alone)
    # From the lower nodes without a partner along edges, and back along the matching.
    back = _links(partner[matched], matched, shape[::-1])
    start = sp.csr_matrix(is_alone[None, :].astype(np.int8))
    paths = sp.bmat([[None, edges, None], [back, None, None], [start, None, [[0]]]], "csr")
    reached = np.zeros(sum(shape) + 1, dtype=bool)
    reached[breadth_first_order(paths, sum(shape), return_predecessors=False)] = True
    return np.concatenate([lows[~reached[: len(lows)]], highs[reached[len(lows) : -1]]])


def _links(rows: Numbers, columns: Numbers, shape: tuple[int, int]) -> sp.csr_matrix:
    return sp.csr_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=shape)


def _unknowns(chosen: BoolArray, size: int) -> IndexArray:
    nodes = np.flatnonzero(chosen)[:, None]
    return (nodes * size + np.arange(size)).reshape(-1).astype(np.int32)


def _graph(matrix: PETSc.Mat) -> tuple[IndexArray, IndexArray]:
    """How many neighbours each owned node has, and their global numbers, node by node."""
    size = matrix.getBlockSize()
    starts, columns, _ = matrix.getValuesCSR()
    nodes = matrix.getSize()[1] // size
    pattern = sp.csr_matrix(
        (np.ones(len(columns), dtype=bool), columns // size, starts[::size]),
        shape=((len(starts) - 1) // size, nodes),
    )
    pattern.sum_duplicates()
    return np.diff(pattern.indptr).astype(np.int32), pattern.indices.astype(np.int32)


def _partition(counts: IndexArray, neighbours: IndexArray, parts: int) -> IndexArray:
    """The part of each node, all of about one size, with few edges between them."""
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
    edges = PETSc.Mat().createAIJ(
        (len(counts), len(counts)),
        csr=(starts, neighbours.astype(PETSc.IntType), np.ones(len(neighbours))),
        comm=PETSc.COMM_SELF,
    )
    graph = edges.convert("mpiadj", PETSc.Mat())
    partitioning = PETSc.MatPartitioning().create(PETSc.COMM_SELF)
    partitioning.setAdjacency(graph)
    options = InsertedOptions({"mat_partitioning_nparts": parts}, prefix=_PREFIX)
    partitioning.setOptionsPrefix(options.prefix)
    result = PETSc.IS()
    try:
        partitioning.setFromOptions()
        partitioning.apply(result)
        found = result.getIndices().astype(np.int32)
    except PETSc.Error:
        # The other ranks wait; they get the one part that is not divided.
        found = np.zeros(len(counts), dtype=np.int32)
    options.remove()
    for item in (result, partitioning, graph, edges):
        item.destroy()
    return found


# A dense matrix on every rank: no more unknowns than these, and no larger share of all.  With it
# two ranks are 1.2 to 1.6 times as fast as with MUMPS, in 2D, and from 2000 unknowns on in 3D; four
# in 3D half as fast, where a seventh of all would be in it.
_LARGEST, _LARGEST_SHARE = 5000, 1.0 / 8.0
# How MUMPS shares its work among ranks depends on their timing: by so many per cent it may need
# more memory than it foresees.
SPARE_MEMORY = 80
# PETSc's numbers for no memory, and for a matrix that is not positive definite.
_NO_MEMORY, _NOT_DEFINITE = 55, 71


class Substructuring:
    """The context of a PETSc preconditioner of type python that solves with its matrix.

    MUMPS takes over where the separator is too large, and where there is nothing to compile with.
    """

    def __init__(self) -> None:
        self._handle: int | None = None
        self._solver: Pieces | Whole | None = None

    @property
    def in_pieces(self) -> bool:
        """Whether each rank factorises a part of its own."""
        return isinstance(self._solver, Pieces)

    def setUp(self, pc: PETSc.PC) -> None:
        """Factorise the present values of the matrix; collective."""
        matrix = pc.getOperators()[1]
        if self._solver is None or matrix.handle != self._handle:
            self.destroy()
            found = _analysed(matrix, pc.getOptionsPrefix())
            self._solver, self._handle = found, matrix.handle
        self._solver.factorise()

    def apply(self, _: PETSc.PC, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """``A^-1 b``; collective."""
        assert self._solver is not None
        self._solver.solve(right, solution)

    def destroy(self, _: PETSc.PC | None = None) -> None:
        """Free what it keeps; collective."""
        if self._solver is not None:
            self._solver.destroy()
        self._solver = self._handle = None


def _analysed(matrix: PETSc.Mat, prefix: str) -> Pieces | Whole:
    comm = matrix.getComm().tompi4py()
    if comm.size > 1 and is_available(comm):
        separator = Separator(matrix)
        limit = min(_LARGEST, _LARGEST_SHARE * matrix.getSize()[0])
        if separator.divides and len(separator.shared) <= limit:
            return Pieces(matrix, separator)
    return Whole(matrix, prefix)


class Whole:
    """One factorisation by MUMPS, with the options under a prefix; collective."""

    def __init__(self, matrix: PETSc.Mat, prefix: str) -> None:
        self._pc = PETSc.PC().create(matrix.getComm())
        self._pc.setOptionsPrefix(prefix)
        self._pc.setType(PETSc.PC.Type.CHOLESKY)
        self._pc.setFactorSolverType("mumps")
        self._pc.setOperators(matrix)
        self._pc.setFactorSetUpSolverType()
        self._pc.getFactorMatrix().setMumpsIcntl(14, SPARE_MEMORY)

    def factorise(self) -> None:
        """Factorise the present values of the matrix; raises PETSc's error; collective."""
        self._pc.setUp()
        if self._pc.getFailedReason():
            raise PETSc.Error(_NOT_DEFINITE)

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """``A^-1 b``; collective."""
        self._pc.apply(right, solution)

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._pc.destroy()


class Pieces:
    """The substructures of one matrix, one for each rank; collective.

    Corners have their unknowns in reverse order, in which their factors are upper triangular, and
    so has the separator.
    """

    def __init__(self, matrix: PETSc.Mat, separator: Separator) -> None:
        self._matrix, self._comm = matrix, matrix.getComm().tompi4py()
        shared, interior = separator.shared, separator.interior
        self._touched = separator.touched
        corner = shared[self._touched]
        numbers = np.union1d(interior, corner)
        self._rows = [_index_set(numbers), _index_set(shared)]
        self._own, self._joint = matrix.createSubMatrices(self._rows)
        self._find_entries()
        inside, outside = (np.searchsorted(numbers, part) for part in (interior, corner))
        self._piece = Substructure(self._own, inside, outside, self._comm)
        self._raise_unless(self._piece.has_memory, _NO_MEMORY)
        self._place = len(shared) - 1 - self._touched[::-1]
        (self._trsv,) = get_blas_funcs(("trsv",))
        self._find_scatters(numbers[self._piece.order[: len(interior)]], shared, separator.mine)

    def factorise(self) -> None:
        """Factorise the present values of the matrix; raises PETSc's error; collective."""
        self._matrix.createSubMatrices(self._rows, submats=[self._own, self._joint])
        is_definite = self._piece.factorise(self._own.getValuesCSR()[2])
        # Otherwise the others would wait for this rank's part of the sum.
        self._raise_unless(is_definite, _NOT_DEFINITE)
        size = self._joint.getSize()[0]
        schur = np.zeros((size, size), order="F")
        schur[np.ix_(self._place, self._place)] = self._piece.complement()
        self._comm.Allreduce(MPI.IN_PLACE, schur)
        # Each rank's complement has what it shares with others of A_GG: it is needed once.
        values = self._joint.getValuesCSR()[2][self._kept]
        schur.reshape(-1, order="F")[self._entries] += self._missing * values
        schur, info = lapack.dpotrf(schur, lower=0, clean=0, overwrite_a=1)
        self._raise_unless(info == 0, _NOT_DEFINITE)
        self._schur = schur

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """``A^-1 b``; collective."""
        count = len(self._local.array_r) - len(self._schur)
        self._gather.scatter(right, self._local)
        local = self._local.array
        part, at_separator = local[:count], local[count:]
        force = np.zeros(len(at_separator))
        force[self._place] = self._piece.forward(part)
        self._comm.Allreduce(MPI.IN_PLACE, force)
        force += at_separator
        for transposed in (1, 0):
            force = self._trsv(self._schur, force, trans=transposed, overwrite_x=1)
        part[:] = self._piece.backward(force[self._place])
        at_separator[:] = force
        self._return.scatter(self._local, solution)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        for item in (*self._rows, self._own, self._joint, self._gather, self._return, self._local):
            item.destroy()

    def _find_entries(self) -> None:
        """The entries of ``A_GG`` above the diagonal, and how often complements miss them."""
        starts, columns, _ = self._joint.getValuesCSR()
        size = len(starts) - 1
        rows = np.repeat(np.arange(size), np.diff(starts))
        self._kept = np.flatnonzero(rows >= columns)
        rows, columns = rows[self._kept], columns[self._kept]
        self._entries = (size - 1 - rows) + size * (size - 1 - columns.astype(np.int64))
        touched = np.zeros(size, dtype=bool)
        touched[self._touched] = True
        self._missing = 1.0 - self._comm.allreduce((touched[rows] & touched[columns]).astype(float))

    def _find_scatters(self, interior: IndexArray, shared: IndexArray, mine: IndexArray) -> None:
        """Between vectors and this rank's part of them: its interior, then the separator."""
        everywhere = self._matrix.createVecRight()
        numbers = np.concatenate([interior, shared[::-1]])
        self._local = PETSc.Vec().createSeq(len(numbers), comm=PETSc.COMM_SELF)
        returned = np.arange(len(interior), dtype=np.int32), len(numbers) - 1 - mine
        kept = np.concatenate(returned)
        sets = [_index_set(chosen) for chosen in (numbers, kept, numbers[kept])]
        self._gather = PETSc.Scatter().create(everywhere, sets[0], self._local, None)
        self._return = PETSc.Scatter().create(self._local, sets[1], everywhere, sets[2])
        for item in (everywhere, *sets):
            item.destroy()

    def _raise_unless(self, succeeds: bool, error: int) -> None:
        """On all ranks what one of them finds; collective."""
        if not self._comm.allreduce(bool(succeeds), op=MPI.LAND):
            raise PETSc.Error(error)


def _index_set(numbers: npt.NDArray[np.integer]) -> PETSc.IS:
    return PETSc.IS().createGeneral(numbers.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
