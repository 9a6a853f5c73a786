"""Every connected part of the body is held: by displacement conditions, or by contact with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la

from contact_locking import compiled, forms
from contact_locking.conditions import (
    Constraints,
    check_held,
    describe_motion,
    free_motions,
    rigid_motions,
    sliding_motions,
)
from contact_locking.domain import Domain
from contact_locking.errors import InputError
from contact_locking.parameters import Parameters
from contact_locking.surface import ContactSurface

BoolArray = npt.NDArray[np.bool_]
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Held:
    """A part of the body, the boundary parts that hold it, and what contact alone holds of it.

    ``free`` is the number of rigid motions that the displacement conditions leave, ``sliding`` the
    number of those among them that friction alone can hold.
    """

    name: str
    displacements: tuple[str, ...]
    contact: tuple[str, ...]
    free: int
    sliding: int

    def __str__(self) -> str:
        words = []
        if self.displacements:
            words.append(f"displacements on {', '.join(self.displacements)}")
        if self.contact and self.free:
            friction = " and friction" if self.sliding else ""
            words.append(f"contact{friction} on {', '.join(self.contact)}")
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
            free, sliding = _check_rigid_motions(
                domain, space, data, constraints, surface, parameters, mask
            )
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
                _touching(domain, number, parameters.contact_names),
                free,
                sliding,
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
) -> tuple[int, int]:
    """How many rigid motions of a part contact holds, how many of them friction alone.

    ``part`` marks the local dofs of the part.  Raises InputError if a motion is free.
    """
    found = _Motions(domain, space, data, constraints, surface, part)
    if not found.free.shape[1]:
        return 0, 0
    normals = found.normals
    friction = any(contact.friction.coefficient != 0 for contact in parameters.contacts)
    check_held(found.free, normals, found.work, domain.dim, friction)
    sliding = 0 if normals is None else sliding_motions(normals).shape[1]
    return int(found.free.shape[1]), sliding


def describe_slide(
    domain: Domain,
    space: fem.FunctionSpace,
    data: forms.ProblemData,
    constraints: Constraints,
    surface: ContactSurface,
) -> str | None:
    """A motion along Gamma_C that friction, with the bound there is, does not stop, in words.

    The loads do more work along it than friction can take, ``(f, c) > int G |c_tau|``.  Looked at
    are the motions along which the loads push the most.  None if friction stops them; collective.
    """
    bound = data.contact.bound.x.array[surface.nodes] if data.contact is not None else np.zeros(0)
    for number in range(len(domain.part_names)):
        mask = _dofs(domain, space, number)
        found = _Motions(domain, space, data, constraints, surface, mask)
        if found.normals is None or not found.free.shape[1]:
            continue
        slides = sliding_motions(found.normals)
        push = slides @ (slides.T @ found.work)
        if not np.any(push):
            continue
        own = surface.is_of(mask)
        slip = np.linalg.norm(np.einsum("fkd,f->kd", found.at_contact, push), axis=1)
        taken = domain.comm.allreduce(float(surface.weights[own] @ (bound[own] * slip)))
        work = float(push @ found.work)
        if work > taken:
            motion = describe_motion(found.free @ push, domain.dim)
            return f"friction cannot hold the body, which is free to move (rigid motion: {motion})"
    return None


class _Motions:
    """The rigid motions of a part that its displacement conditions leave; collective to make.

    ``free`` (m, f) are their coefficients, ``work`` (f,) that of the loads, ``at_contact``
    (f, k, d) the motions at the owned nodes of Gamma_C on the part, and ``normals`` (n, f) their
    normal components at all such nodes, None if there are none.
    """

    def __init__(
        self,
        domain: Domain,
        space: fem.FunctionSpace,
        data: forms.ProblemData,
        constraints: Constraints,
        surface: ContactSurface | None,
        part: BoolArray,
    ) -> None:
        self.free = free_motions(domain, space, constraints, part)
        self.normals: FloatArray | None = None
        if not self.free.shape[1]:
            return
        motions = (self.free.T @ rigid_motions(space)) * part
        work_form = compiled.form(forms.external_work(ufl.TestFunction(space), data))
        self.work = domain.comm.allreduce(motions @ fem.assemble_vector(work_form).array)
        if surface is None or data.contact is None:
            return
        own = surface.blocks[surface.is_of(part)]
        self.at_contact = motions.reshape(len(motions), -1, domain.dim)[:, own]
        nu = data.contact.normal.x.array.reshape(-1, domain.dim)[own]
        local = np.einsum("fkd,kd->kf", self.at_contact, nu)
        normals = np.concatenate(domain.comm.allgather(local))
        self.normals = normals if len(normals) else None


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
