"""Every connected part of the body is held: by displacement conditions, or by contact with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la

from contact_locking import compiled, forms
from contact_locking.conditions import Constraints, check_held, free_motions, rigid_motions
from contact_locking.domain import Domain
from contact_locking.errors import InputError
from contact_locking.parameters import Parameters
from contact_locking.surface import ContactSurface

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Held:
    """A part of the body, the boundary parts that hold it, and what contact alone holds of it.

    ``free`` is the number of rigid motions that the displacement conditions leave.
    """

    name: str
    displacements: tuple[str, ...]
    contact: tuple[str, ...]
    free: int

    def __str__(self) -> str:
        words = []
        if self.displacements:
            words.append(f"displacements on {', '.join(self.displacements)}")
        if self.contact and self.free:
            words.append(f"contact on {', '.join(self.contact)}")
        return " and ".join(words)


def check_parts_held(
    domain: Domain,
    space: fem.FunctionSpace,
    data: forms.ProblemData,
    constraints: Constraints,
    surface: ContactSurface | None,
    parameters: Parameters,
) -> list[Held]:
    """What holds each part; raises InputError for one that is free to move; collective."""
    several = len(domain.part_names) > 1
    found = []
    for number, name in enumerate(domain.part_names):
        mask = _dofs(domain, space, number)
        try:
            free = _check_rigid_motions(domain, space, data, constraints, surface, parameters, mask)
        except InputError as error:
            if not several:
                raise
            shared = "edge" if domain.dim == 2 else "face"
            raise InputError(
                f"{name} is loose, as it shares no {shared} with the rest: {error}", error.key
            ) from None
        on = [part for item in parameters.loads.displacements for part in item.on]
        found.append(
            Held(
                name,
                _touching(domain, number, list(dict.fromkeys(on))),
                _touching(domain, number, parameters.contact.on),
                free,
            )
        )
    return found


def _check_rigid_motions(
    domain: Domain,
    space: fem.FunctionSpace,
    data: forms.ProblemData,
    constraints: Constraints,
    surface: ContactSurface | None,
    parameters: Parameters,
    part: BoolArray,
) -> int:
    """How many rigid motions of a part contact alone holds; InputError if one is free.

    ``part`` marks the local dofs of the part.
    """
    free = free_motions(domain, space, constraints, part)
    if not free.shape[1]:
        return 0
    motions = (free.T @ rigid_motions(space)) * part
    work_form = compiled.form(forms.external_work(ufl.TestFunction(space), data))
    load = fem.assemble_vector(work_form).array
    work = domain.comm.allreduce(motions @ load)
    normals = None
    if surface is not None and data.contact is not None:
        own = surface.blocks[part[surface.blocks * domain.dim]]
        blocks = motions.reshape(len(motions), -1, domain.dim)[:, own]
        nu = data.contact.normal.x.array.reshape(-1, domain.dim)[own]
        local = np.einsum("fkd,kd->kf", blocks, nu)
        normals = np.concatenate(domain.comm.allgather(local))
    if normals is not None and not len(normals):
        normals = None
    friction = parameters.friction.coefficient != 0
    check_held(free, normals, work, domain.dim, friction)
    return int(free.shape[1])


def _dofs(domain: Domain, space: fem.FunctionSpace, part: int) -> BoolArray:
    """The local dofs of a part's cells, ghosts included; collective."""
    dofmap = space.dofmap
    marks = la.vector(dofmap.index_map)
    marks.array[:] = 0.0
    marks.array[np.unique(dofmap.list[np.flatnonzero(domain.parts == part)])] = 1.0
    # A rank may know a node of the part, and no cell of it.
    marks.scatter_reverse(la.InsertMode.add)
    marks.scatter_forward()
    return np.repeat(marks.array > 0.0, dofmap.index_map_bs)


def _touching(domain: Domain, part: int, names: Sequence[str]) -> tuple[str, ...]:
    """Those of the boundary parts that have facets of a part of the body; collective."""
    there = [
        bool(np.any(domain.parts[domain.owners(domain.facets((name,)))] == part)) for name in names
    ]
    anywhere = np.any(domain.comm.allgather(there), axis=0)
    return tuple(name for name, here in zip(names, anywhere, strict=True) if here)
