"""The mesh of an axisymmetric body: a half section with the coordinates (r, z) = (x, y), r >= 0."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from dolfinx import fem

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import on_any_rank

# A node with a smaller radius than this share of the largest radius lies on the axis.
_ON_AXIS = 1e-9


def half_section(domain: Domain, key: str = "mesh.axisymmetric") -> Domain:
    """The domain as the half section of a body of revolution about x = 0; collective.

    Coordinates x that are zero except for rounding become zero.  Raises InputError for a mesh in
    three dimensions, and for a mesh that crosses the axis; ``key`` is what asks for the section.
    """
    if domain.dim != 2:
        raise InputError(
            "needs a mesh in two dimensions, the half section of the body in the coordinates "
            "(r, z) = (x, y)",
            key,
        )
    low, high = domain.bounding_box
    radius = domain.mesh.geometry.x[:, 0]
    if low[0] < -_ON_AXIS * high[0]:
        hint = "; take its half with quarter: true" if domain.origin in ("disc", "annulus") else ""
        raise InputError(
            f"the half section must lie in x >= 0, where x is the radius r, and {domain.origin} "
            f"reaches x = {low[0]:.6g}{hint}",
            key,
        )
    radius[np.abs(radius) <= _ON_AXIS * high[0]] = 0.0
    return replace(domain, axisymmetric=True)


def is_on_axis(domain: Domain, x: FloatArray) -> BoolArray:
    """Which of the points x (d, k) lie on the axis, (k,); collective."""
    return np.asarray(np.abs(x[0]) <= _ON_AXIS * domain.bounding_box[1, 0])


def axis_dofs(domain: Domain, space: fem.FunctionSpace) -> IndexArray:
    """The local dofs of u_r on the axis; collective."""
    on_axis = is_on_axis(domain, space.tabulate_dof_coordinates().T)
    return np.flatnonzero(on_axis).astype(np.int32) * np.int32(domain.dim)


def require_surface(domain: Domain, names: tuple[str, ...], key: str) -> None:
    """Raise InputError for boundary parts on the axis, which are no surface; collective."""
    if not domain.axisymmetric:
        return
    for name in names:
        facets = domain.facets((name,), key)
        if not domain.comm.allreduce(len(facets)):
            continue
        nodes = _compat.entities_to_geometry(domain.mesh, 1, facets)
        if not on_any_rank(domain.comm, domain.mesh.geometry.x[nodes, 0] > 0.0):
            raise InputError(f"{name!r} lies on the axis of revolution and is no surface", key)
