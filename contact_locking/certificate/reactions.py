"""Reactions on named boundary parts, and the nodes of contacts that conditions hold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray, IndexArray
from contact_locking.mesh.domain import Domain, is_on_axis
from contact_locking.supports.conditions import Constraints

# A unit normal lies along prescribed directions if less than this is left.
_ALONG = 1e-6


def reactions_by_part(
    domain: Domain, constraints: Constraints, reaction: FloatArray
) -> dict[str, FloatArray]:
    """The resultant (d,) on the body of the reactions of each boundary part; collective."""
    return {
        name: np.asarray(domain.comm.allreduce(share.reshape(-1, domain.dim).sum(axis=0)))
        for name, share in shares_by_part(domain, constraints, reaction).items()
    }


def shares_by_part(
    domain: Domain, constraints: Constraints, reaction: FloatArray
) -> dict[str, FloatArray]:
    """The share (k,) of each boundary part in the reactions; linear, node by node; collective.

    ``reaction`` (k,) are the reactions at the owned dofs of displacements, zero at free dofs.  The
    reaction of a node is a sum of forces along the components and directions that the parts
    prescribe there.  Parts that prescribe the same component of the same node have equal shares of
    its reaction, so that the resultants add up to the sum of all reactions.
    """
    dim, nodes = domain.dim, np.arange(len(reaction) // domain.dim, dtype=np.int32)
    rows = list(_rows(domain, constraints, nodes))
    nodes = np.unique(np.concatenate([nodes[:0], *(places for _, places, _ in rows)]))
    # The forces ``c_i m_i`` with ``sum c_i m_i = r`` and the least ``sum c_i^2``.
    gram = np.zeros((len(nodes), dim, dim))
    for _, places, m in rows:
        np.add.at(gram, np.searchsorted(nodes, places), np.einsum("ki,kj->kij", m, m))
    inverse = np.linalg.pinv(gram, rcond=1e-12, hermitian=True)
    solved = np.einsum("kij,kj->ki", inverse, reaction.reshape(-1, dim)[nodes])
    shares: dict[str, FloatArray] = {}
    for name, places, m in rows:
        share = shares.setdefault(name, np.zeros_like(reaction)).reshape(-1, dim)
        sizes = np.sum(m * solved[np.searchsorted(nodes, places)], axis=1)
        np.add.at(share, places, sizes[:, None] * m)
    return shares


def are_held(
    domain: Domain, constraints: Constraints, nodes: IndexArray, normals: FloatArray
) -> BoolArray:
    """(k,) whether the conditions prescribe the displacement of nodes along normals (k, d).

    ``nodes`` (k,) are owned blocks of the displacement space.  The directions are those that the
    study file prescribes on the boundary parts around a node, and x on the axis of revolution: the
    constraints of the solver are not used.  Collective.
    """
    dim, space = domain.dim, constraints.space
    spans = np.zeros((len(nodes), dim, dim))
    for _, places, directions in _rows(domain, constraints, nodes):
        np.add.at(spans, places, np.einsum("ki,kj->kij", directions, directions))
    if domain.axisymmetric:
        points = space.tabulate_dof_coordinates()[nodes]
        spans[is_on_axis(domain, points.T), 0, 0] += 1.0
    onto = np.einsum("kij,kjl->kil", np.linalg.pinv(spans, rcond=1e-12, hermitian=True), spans)
    left = normals - np.einsum("kij,kj->ki", onto, normals)
    return np.asarray(np.linalg.norm(left, axis=1) <= _ALONG)


def _rows(
    domain: Domain, constraints: Constraints, nodes: IndexArray
) -> Iterator[tuple[str, IndexArray, FloatArray]]:
    """For each part, the positions in ``nodes`` (m,) and the directions (m, d) that it holds."""
    dim = domain.dim
    for placed in (*constraints.components, *constraints.oblique):
        for name in placed.on:
            facets = domain.facets((name,), placed.key)
            on_part = fem.locate_dofs_topological(constraints.space, dim - 1, facets)
            places, directions = placed.rows_at(nodes)
            here = np.isin(nodes[places], on_part)
            yield name, places[here], directions[here]
    for number, own in enumerate(constraints.given):
        dofs = own.dof_indices()[0]
        for axis, direction in enumerate(np.eye(dim)):
            places = np.flatnonzero(np.isin(dim * nodes + axis, dofs)).astype(np.int32)
            yield f"bcs.{number}", places, np.tile(direction, (len(places), 1))
