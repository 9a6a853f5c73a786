"""The distance of two displacements of one problem."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.errors import InputError
from contact_locking.fem import compiled
from contact_locking.laws.locking import squared_norm
from contact_locking.parallel import on_every_rank
from contact_locking.problem import forms
from contact_locking.problem.forms import ProblemData


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
