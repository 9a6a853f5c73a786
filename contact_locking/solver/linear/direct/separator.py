"""Nodes without which the graph of a matrix falls into one part for each rank."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from petsc4py import PETSc
from scipy.sparse.csgraph import breadth_first_order, maximum_bipartite_matching

from contact_locking.arrays import BoolArray, IndexArray
from contact_locking.solver.linear.direct.substructure import Numbers
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
    partitioning.setOptionsPrefix(_PREFIX)
    partitioning.setAdjacency(graph)
    options = InsertedOptions({"mat_partitioning_nparts": parts}, prefix=_PREFIX)
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
