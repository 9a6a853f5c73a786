"""Whether the mesh and the element of a checkpoint are those of a problem."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.checkpoint.record import Record
from contact_locking.errors import InputError
from contact_locking.parallel import maximum, on_every_rank
from contact_locking.study.assembly import StudyProblem

# The coordinates of the same mesh may differ by this share of the extent, because another machine
# may have made the mesh.
_SAME_PLACE = 1e-9


def places(space: fem.FunctionSpace) -> fem.Function:
    """The coordinates x as a function; collective."""
    found = fem.Function(space)
    dim = space.mesh.geometry.dim
    found.interpolate(lambda x: x[:dim])
    return found


def difference_in_size(record: Record, problem: StudyProblem) -> str:
    """The difference in size between the two meshes, in words; empty if there is none.

    Raises InputError if the elements differ, or if only one of the bodies is axisymmetric.
    """
    element = problem.element
    if record.degree != element.degree:
        raise InputError(
            f"the checkpoint is of elements of degree {record.degree}, and the study has degree "
            f"{element.degree}; restart with discretisation.degree: {record.degree}",
            "discretisation.degree",
        )
    if record.limit_at != element.limit_at:
        raise InputError(
            f"the checkpoint has the locking limit at {record.limit_at}, and the study has the "
            f"limit at {element.limit_at}; restart with discretisation.limit_at: {record.limit_at}",
            "discretisation.limit_at",
        )
    revolution = bool(record.mesh.get("axisymmetric", False))
    if revolution != problem.domain.axisymmetric:
        raise InputError(
            f"the checkpoint is of a body that is {'' if revolution else 'not '}axisymmetric; "
            f"restart with mesh.axisymmetric: {str(revolution).lower()}",
            "mesh.axisymmetric",
        )
    nodes = int(problem.u.function_space.dofmap.index_map.size_global)
    here = (problem.domain.dim, problem.domain.num_cells, nodes)
    there = (record.dimension, record.cells, record.nodes)
    text = "{}D with {} cells and {} nodes"
    return "" if here == there else f"it is {text.format(*there)}, this one is {text.format(*here)}"


def difference_in_places(saved: fem.Function) -> str:
    """The difference between the coordinates of the nodes, in words; collective."""
    comm = saved.function_space.mesh.comm
    expected = places(saved.function_space).x.array
    extent = maximum(comm, np.abs(expected))
    same = np.abs(saved.x.array - expected) <= _SAME_PLACE * extent
    return "" if on_every_rank(comm, same) else "its nodes lie elsewhere"


def another_mesh(
    directory: str | Path, difference: str, record: Record, identity: dict[str, Any]
) -> str:
    """The message about a checkpoint of another mesh, with the parameters that differ."""
    names = [name for name in {**record.mesh, **identity} if name not in ("content", "refined")]
    changes = [
        f"mesh.{name} was {record.mesh.get(name)}, is {identity.get(name)}"
        for name in names
        if record.mesh.get(name) != identity.get(name)
    ]
    if record.mesh.get("content") != identity.get("content"):
        changes = ["the mesh file is another one or has changed"]
    if record.mesh.get("refined") != identity.get("refined"):
        changes.append("it was refined; restart with a section adapt, which takes the refined mesh")
    # Another version of Gmsh makes another mesh of the same parameters.
    told = "; ".join(changes) or "perhaps another version of Gmsh; a mesh.file would not change"
    return (
        f"the checkpoint in {directory} is of another mesh: {difference} ({told}); "
        "restart with the mesh of the checkpoint"
    )
