"""The named groups of a mesh: number of entities, measure and mean normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking import _compat
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.lagrange import measures

# A boundary part is plane if the mean normal is longer, and closed if the mean normal is shorter.
_FLAT, _CLOSED = 1.0 - 1e-6, 1e-2


@dataclass(frozen=True)
class Group:
    """A group: the number of its cells or facets, their measure, and the mean outward normal.

    The mean normal ``int nu / int 1`` of a boundary part is a unit vector for a plane part, shorter
    for a curved part, and zero for a closed part.  A region has none.
    """

    name: str
    dim: int
    count: int
    measure: float
    normal: tuple[float, ...] | None = None

    def facing(self) -> str:
        """The mean normal in words; empty for a region."""
        if self.normal is None:
            return ""
        length = float(np.linalg.norm(self.normal))
        if length < _CLOSED:
            return "all ways (closed)"
        shown = ", ".join(f"{x:.3g}" for x in np.round(self.normal, 9) + 0.0)
        return f"({shown}){'' if length > _FLAT else ' (curved)'}"


def groups(domain: Domain) -> list[Group]:
    """The regions, then the boundary parts, sorted by name; collective."""
    dim = domain.dim
    cells = [_region(domain, name) for name in sorted(domain.cell_names)]
    return cells + [_boundary(domain, name, dim - 1) for name in sorted(domain.facet_names)]


def table(rows: list[Group]) -> list[tuple[str, str, str, str, str]]:
    """The groups as rows of text below a row of titles."""
    kinds = {1: "length", 2: "area", 3: "volume"}
    titles = ("group", "dimension", "entities", "measure", "mean outward normal")
    return [titles] + [
        (r.name, str(r.dim), str(r.count), f"{kinds[r.dim]} {r.measure:.6g}", r.facing())
        for r in rows
    ]


def _region(domain: Domain, name: str) -> Group:
    cells = domain.cells(name)
    cells = cells[cells < domain.mesh.topology.index_map(domain.dim).size_local]
    corners = domain.mesh.geometry.x[_compat.cell_corners(domain.mesh)[cells], : domain.dim]
    local = len(cells), float(measures(domain.kind, corners).sum())
    count, measure = (domain.comm.allreduce(x) for x in local)
    return Group(name, domain.dim, count, measure)


def _boundary(domain: Domain, name: str, dim: int) -> Group:
    facets = domain.facets((name,))
    facets = facets[facets < domain.mesh.topology.index_map(dim).size_local]
    normals, areas = domain.area_normals(facets)
    count, measure, total = (
        domain.comm.allreduce(x) for x in (len(facets), float(areas.sum()), normals.sum(axis=0))
    )
    return Group(name, dim, count, measure, tuple(float(x) for x in total / measure))
