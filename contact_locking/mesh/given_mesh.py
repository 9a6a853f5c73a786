"""A mesh that the user has made, as the domain of a problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import mesh as dmesh

from contact_locking import _compat
from contact_locking.arrays import BoolArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.mesh.cell_kind import NAMED
from contact_locking.mesh.diagnosis import connected_parts
from contact_locking.mesh.distribution import Regions, marked_facets
from contact_locking.mesh.domain import Domain, Where, assembled
from contact_locking.parallel import agree, on_any_rank
from contact_locking.plain_text import nearest


class NamedFacets:
    """Boundary parts by names: those of ``names``, which are values of ``tags``, and given facets.

    Every place of a problem is told by :meth:`add` before :meth:`domain` makes the domain.
    """

    def __init__(
        self,
        mesh: dmesh.Mesh,
        tags: dmesh.MeshTags | None = None,
        names: Mapping[str, int] | None = None,
    ) -> None:
        if mesh.topology.cell_name() not in NAMED:
            known = ", ".join(kind.plural for kind in NAMED.values())
            raise InputError(f"must have cells of one kind of these: {known}", "mesh")
        if mesh.geometry.dim != mesh.topology.dim:
            raise InputError("must have cells that fill the space around them", "mesh")
        if _compat.coordinate_map(mesh).degree > 1:
            raise InputError(
                "must have cells with straight sides; make the mesh of first order "
                "(gmsh.model.mesh.setOrder(1))",
                "mesh",
            )
        self._mesh, self._tags, self._names = mesh, tags, dict(names or {})
        dim = mesh.topology.dim
        mesh.topology.create_entities(dim - 1)
        mesh.topology.create_connectivity(dim - 1, dim)
        mesh.topology.create_connectivity(dim, dim - 1)
        self._places: dict[str, BoolArray] = {}
        if self._names and tags is None:
            raise InputError("needs the mesh tags whose values have the names", "tags")
        self._outside = marked_facets(mesh, np.asarray(dmesh.exterior_facet_indices(mesh.topology)))

    def add(self, where: Where, key: str) -> tuple[str, ...]:
        """Add a place, and return its names; collective.

        Raises InputError with the key for a name that is not there, and for facets that are not on
        the boundary.
        """
        mesh, comm = self._mesh, self._mesh.comm
        if isinstance(where, str):
            where = (where,)
        if callable(where):
            raise InputError(
                "must be names, facets or (mesh tags, value), and no function: "
                "dolfinx.mesh.locate_entities_boundary finds facets by a function",
                key,
            )
        if not hasattr(where, "__len__"):
            kind = type(where).__name__
            raise InputError(f"must be names, facets or (mesh tags, value), not {kind}", key)
        places: dict[str, npt.NDArray[Any]] = {}
        if len(where) and all(isinstance(name, str) for name in where):
            for name in where:
                if name not in self._names:
                    known = ", ".join(sorted(self._names)) or "none at all"
                    hint = nearest(name, self._names)
                    message = f"no boundary part is named {name!r}{hint}; names has: {known}"
                    raise InputError(message, key)
                assert self._tags is not None
                places[name] = np.asarray(self._tags.find(self._names[name]))
        elif len(where) == 2 and isinstance(where[0], dmesh.MeshTags):
            places[key] = np.asarray(where[0].find(where[1]))
        else:
            places[key] = np.asarray(where)
        count = len(self._outside)
        for name, facets in places.items():

            def checked(facets: npt.NDArray[Any] = facets) -> IndexArray:
                if len(facets) and facets.dtype.kind not in "iu":
                    hint = "; np.flatnonzero gives those of marks" if facets.dtype == bool else ""
                    raise InputError(f"must be the local numbers of facets{hint}", key)
                if np.any((facets < 0) | (facets >= count)):
                    message = f"has numbers that are no facets of the mesh, which has {count}"
                    raise InputError(message, key)
                return facets.astype(np.int32)

            marks = marked_facets(mesh, agree(comm, checked))
            if not on_any_rank(comm, marks):
                message = "has no facet"
                if name in self._names:
                    message = f"no facet has the tag {self._names[name]} of {name!r}"
                raise InputError(message, key)
            if on_any_rank(comm, marks & ~self._outside):
                raise InputError("has facets that are not on the boundary of the mesh", key)
            self._places[name] = marks
        return tuple(places)

    def domain(self) -> Domain:
        """The domain with these boundary parts; collective."""
        parts = connected_parts(self._mesh)
        none = Regions(np.zeros_like(parts[0]), {})
        return assembled(self._mesh, none, self._places, parts=parts)
