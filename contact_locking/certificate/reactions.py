"""The reactions of the named boundary parts that have prescribed displacements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.problem.conditions import ComponentCondition
from contact_locking.problem.domain import Domain


def reactions_by_part(
    domain: Domain,
    space: fem.FunctionSpace,
    wanted: Sequence[ComponentCondition],
    reaction: FloatArray,
) -> dict[str, FloatArray]:
    """The resultant (d,) on the body of the reactions of each boundary part; collective.

    ``reaction`` (k,) are the reactions at the owned dofs of the ``space`` of displacements, zero at
    free dofs.  Parts that prescribe the same component of the same node have equal shares of its
    reaction, so that the resultants add up to the sum of all reactions.
    """
    dim = domain.dim
    held: dict[str, list[IndexArray]] = {}
    for condition in wanted:
        for name in condition.on:
            facets = domain.facets((name,), condition.key)
            nodes = fem.locate_dofs_topological(space, dim - 1, facets)
            held.setdefault(name, []).append(dim * nodes + condition.component)
    owned = {name: np.unique(np.concatenate(dofs)) for name, dofs in held.items()}
    owned = {name: dofs[dofs < len(reaction)] for name, dofs in owned.items()}
    holders = np.zeros(len(reaction))
    for dofs in owned.values():
        holders[dofs] += 1.0
    found = {}
    for name, dofs in owned.items():
        share = np.zeros_like(reaction)
        share[dofs] = reaction[dofs] / holders[dofs]
        found[name] = np.asarray(domain.comm.allreduce(share.reshape(-1, dim).sum(axis=0)))
    return found
