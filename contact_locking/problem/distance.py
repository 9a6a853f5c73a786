"""The distance of two displacements of one problem, also from mesh to mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking import _compat
from contact_locking.errors import InputError
from contact_locking.fem import compiled
from contact_locking.laws.convex import squared_norm
from contact_locking.parallel import maximum, on_any_rank, on_every_rank
from contact_locking.problem import forms
from contact_locking.problem.forms import ProblemData

# A node may lie outside the other mesh by this share of the body because of rounding.
_PADDING = 1e-8


def distance(u: fem.Function, other: fem.Function, data: ProblemData) -> dict[str, float]:
    """``sqrt(a(u - w, u - w))`` and ``|eps(u - w)|`` of displacements u and w; collective.

    They are ``energy_norm`` and ``displacement_norm``, and ``relative`` is the first over
    ``sqrt(a(u, u))``.  Raises InputError for displacements of other meshes, distributions or
    degrees.
    """
    mesh = u.function_space.mesh
    comm = mesh.comm
    here, there = mesh.geometry.x, other.function_space.mesh.geometry.x
    is_alike = np.array_equal(here, there) and len(u.x.array) == len(other.x.array)
    if not on_every_rank(comm, is_alike):
        raise InputError("must be a solution on the same mesh, of the same degree", "other")
    difference = fem.Function(u.function_space)
    difference.x.array[:] = u.x.array - other.x.array

    def total(form: Any) -> float:
        return float(np.sqrt(comm.allreduce(fem.assemble_scalar(compiled.form(form)))))

    energy = total(forms.elastic_form(difference, difference, data))
    size = total(forms.elastic_form(u, u, data))
    return {
        "energy_norm": energy,
        "relative": energy / size if size > 0.0 else energy,
        "displacement_norm": total(
            squared_norm(data.strain(difference)) * data.element.elastic_dx(data.dx)
        ),
    }


def on_mesh_of(u: fem.Function, other: fem.Function) -> fem.Function:
    """``u`` interpolated into the space of ``other``, on the same or another mesh; collective.

    Raises ValueError if a node of ``other`` lies in no cell of the mesh of u.
    """
    space, source = other.function_space, u.function_space
    found = fem.Function(space)
    if source.mesh is space.mesh:
        found.interpolate(u)
        return found
    mesh = space.mesh
    cells = mesh.topology.index_map(mesh.topology.dim)
    everywhere = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
    x = source.mesh.geometry.x
    padding = _PADDING * maximum(source.mesh.comm, np.abs(x))
    owners = fem.create_interpolation_data(space, source, everywhere, padding=padding)
    if on_any_rank(mesh.comm, _compat.point_owners(owners) < 0):
        raise ValueError("the mesh of the reference reaches beyond the mesh of the solution")
    found.interpolate_nonmatching(u, everywhere, owners)
    found.x.scatter_forward()
    return found
