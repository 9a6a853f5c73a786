"""The named parts of the boundary of a mesh as tags of facets; parts may overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import mesh as dmesh

from contact_locking.arrays import BoolArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.mesh import rank_sums
from contact_locking.mesh.diagnosis import DistributedCells
from contact_locking.mesh.file import places


@dataclass(frozen=True)
class EntityGroup:
    """The local ``entities`` (k,), cells or facets, of a group in a file.

    ``missing`` more entities of the group, one of them the ``example``, are no facets of the mesh.
    """

    name: str
    entities: IndexArray
    missing: int = 0
    example: str = ""


def on_boundary(
    groups: Sequence[EntityGroup], cells: DistributedCells
) -> tuple[list[EntityGroup], dict[str, str], list[str]]:
    """The groups with their facets on the boundary, and warnings; collective.

    For the name of every other group there is the reason why it bounds nothing.
    """
    kept: list[EntityGroup] = []
    unusable: dict[str, str] = {}
    warnings: list[str] = []
    comm, kind = cells.comm, cells.data.kind
    what, lines = "edge" if kind.dim == 2 else "face", f"{places.of_facets(kind)}s"
    for group in groups:
        name, inner = group.name, cells.shared[group.entities] == 2
        owned = group.entities < cells.owned_facets
        here, inside = (
            comm.allreduce(int(np.count_nonzero(marks))) for marks in (owned, owned & inner)
        )
        total = here + group.missing
        if group.missing:
            example = f", such as {group.example}" if group.example else ""
            unusable[name] = (
                f"{name!r} does not lie on the body: {group.missing} of its {total} {lines} are no "
                f"{what}s of the body's {kind.plural}{example}; remove what dangles, or make it "
                "part of the body's mesh (fragment)"
            )
            warnings.append(f"group {unusable[name]}")
        elif inside == total:
            unusable[name] = (
                f"{name!r} lies inside the body and is not a part of its boundary: its {lines} "
                "have cells on both sides"
            )
        else:
            if inside:
                own = group.entities[inner & owned]
                example = next(filter(None, comm.allgather(cells.first_facet(own))))
                warnings.append(
                    f"group {name!r} is boundary in part only: {inside} of its {total} {lines} "
                    f"have cells on both sides and are left out, such as the {what} {example}"
                )
            kept.append(EntityGroup(name, group.entities[~inner]))
    require_different([group.name for group in kept], f"{what}s")
    return kept, unusable, warnings


def require_different(names: Sequence[str], kind: str) -> None:
    """Raise InputError for a name that two groups of the kind have."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"it has two groups of {kind} named {name!r}")


def marked(mesh: dmesh.Mesh, facets: IndexArray) -> BoolArray:
    """Which local facets, ghosts included, any rank has in ``facets``; collective."""
    return rank_sums.marked(mesh.topology.index_map(mesh.topology.dim - 1), facets)


def tags_of(
    mesh: dmesh.Mesh, marks: Mapping[str, BoolArray]
) -> tuple[dmesh.MeshTags, dict[str, tuple[int, ...]]]:
    """Tags of facets, and for each name of ``marks`` the values of its facets; collective.

    Facets that several names share have a value of their own.
    """
    facets_of_rank = mesh.topology.index_map(mesh.topology.dim - 1)
    count = facets_of_rank.size_local + facets_of_rank.num_ghosts
    every = np.array(list(marks.values())).reshape(len(marks), count)
    facets = np.flatnonzero(every.any(axis=0)).astype(np.int32)
    local, place = np.unique(every[:, facets].T, axis=0, return_inverse=True)
    kinds: BoolArray = np.unique(np.concatenate(mesh.comm.allgather(local)), axis=0)[::-1]
    values = 1 + np.nonzero((local[:, None] == kinds).all(axis=2))[1].astype(np.int32)
    of_name = {
        name: tuple((1 + np.flatnonzero(kinds[:, column])).tolist())
        for column, name in enumerate(marks)
    }
    tags = dmesh.meshtags(mesh, mesh.topology.dim - 1, facets, values[place.reshape(-1)])
    return tags, of_name
