"""The nodes between parts of a graph: an end of each edge that is cut, and as few as can be."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.csgraph import maximum_bipartite_matching

from contact_locking.arrays import IndexArray
from contact_locking.solver.linear.direct.substructuring import least_cover

pytestmark = pytest.mark.serial


def drawn(seed: int) -> tuple[IndexArray, IndexArray]:
    """Some edges between up to 30 nodes and up to 30 others, each once."""
    random = np.random.default_rng(seed)
    lower, higher = random.integers(1, 30, 2)
    edges = random.choice(lower * higher, random.integers(0, lower * higher + 1), replace=False)
    edges = edges[: random.integers(0, 90)]
    return (edges % lower).astype(np.int32), (100 + edges // lower).astype(np.int32)


@pytest.mark.parametrize("seed", range(40))
def test_a_cover_has_an_end_of_each_edge_and_no_more_nodes_than_a_matching(seed: int) -> None:
    lower, higher = drawn(seed)
    cover = least_cover(lower, higher)
    assert (np.isin(lower, cover) | np.isin(higher, cover)).all()
    edges = sp.csr_matrix((np.ones(len(lower)), (lower, higher - 100)), shape=(30, 30))
    # Each edge of a matching needs a node of its own.
    assert len(cover) == np.sum(maximum_bipartite_matching(edges) >= 0)


def test_one_node_covers_a_star_from_either_side() -> None:
    leaves, centre = np.arange(5, dtype=np.int32), np.full(5, 9, dtype=np.int32)
    assert least_cover(leaves, centre).tolist() == [9]
    assert least_cover(centre, leaves + 10).tolist() == [9]


@pytest.mark.parametrize("seed", range(10))
def test_with_three_parts_a_node_may_be_at_lower_and_at_higher_ends(seed: int) -> None:
    lower, higher = drawn(seed)
    higher = (higher - 85).astype(np.int32)
    cover = least_cover(lower, higher)
    assert (np.isin(lower, cover) | np.isin(higher, cover)).all()


def test_without_edges_there_is_nothing_to_cover() -> None:
    assert not len(least_cover(np.zeros(0, np.int32), np.zeros(0, np.int32)))
