"""The material of a study file in its cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from contact_locking.arrays import IndexArray
from contact_locking.fields.clock import Clock
from contact_locking.fields.sampling import Entities, features
from contact_locking.mesh.domain import Domain
from contact_locking.problem.discrete_problem import Body
from contact_locking.problem.points import Placed
from contact_locking.study_file.parameters import expressions
from contact_locking.study_file.parameters.material import MaterialParameters, Region
from contact_locking.values.concept import dotted

_ADVICE = "refine the mesh there, or let a boundary of material.regions go there"
_ADVICE_ON_CELLS = "refine the mesh there, or let a boundary of the region in its on go there"


def material_in_cells(domain: Domain, given: MaterialParameters) -> dict[str, Any]:
    """The entries of a `Body` about its material; collective.

    Raises InputError for a region that the mesh does not have.
    """
    index_map = domain.mesh.topology.index_map(domain.dim)
    everywhere: IndexArray = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    law = given.elasticity.model_copy(update={"plane": given.plane})
    elasticity = [Placed(law, "material.elasticity", everywhere)]
    limited: list[tuple[str, Region]] = [("material", given)]
    # The limits of a region replace those of the material and of regions before it.
    owner, regions = np.zeros(len(everywhere), dtype=np.int32), []
    for name, region in given.regions.items():
        key = f"material.regions.{name}"
        regions.append(domain.cells(name, key))
        if region.elasticity is not None:
            elasticity.append(Placed(region.elasticity, f"{key}.elasticity", regions[-1]))
        if region.limits() is not None:
            owner[regions[-1]] = len(limited)
            limited.append((key, region))
    limits = []
    for number, (above, section) in enumerate(limited):
        inside = np.flatnonzero(owner == number).astype(np.int32)
        for place, limit in section.limits() or ():
            key = dotted(above, *place)
            limits.append(Placed(limit, key, inside, key if "locking_limit" in place else ""))
    eigenstrains = []
    for place, item in given.eigenstrains:
        key, inside = dotted("material", *place), everywhere
        if item.on is not None:
            parts = [domain.cells(name, f"{key}.on") for name in item.on]
            inside = np.unique(np.concatenate(parts)).astype(np.int32)
            regions.append(inside)
        eigenstrains.append(Placed(item, key, inside))
    return dict(elasticity=elasticity, eigenstrains=eigenstrains, limits=limits, regions=regions)


def material_warnings(body: Body, clock: Clock) -> list[str]:
    """Features of the data between the points of the strains; collective.

    Raises InputError for a pole there.
    """
    told = []
    for items, advice, relative in (
        ((*body.elasticity, *body.limits), _ADVICE, "each"),
        (body.eigenstrains, _ADVICE_ON_CELLS, "all"),
    ):
        found = [(item, *one) for item in items for one in expressions(item.given)]
        for item, place, value, _ in found:
            assert item.cells is not None
            inside = Entities.of(body.domain, body.domain.dim, item.cells)
            key = item.key_of(*place)
            told += features(inside, value, key, advice, relative, clock.some_times)
    return told
