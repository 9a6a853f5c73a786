"""The locking stress, contact pressure and friction traction as unknowns of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import dolfinx
import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.fem import compiled
from contact_locking.fem.compiled import Kept
from contact_locking.problem.forms import ProblemData
from contact_locking.problem.system import PenalisedSystem


@dataclass(frozen=True)
class ContactForces:
    """Pressure (k,) and ``-sigma_tau`` (k, d) at the owned nodes of one part of Gamma_C.

    ``touches`` (k,) says where the body is in contact; elsewhere the pressure vanishes up to the
    solver's tolerance only.
    """

    pressure: FloatArray
    friction: FloatArray
    touches: BoolArray

    @classmethod
    def none(cls, nodes: int, dim: int) -> ContactForces:
        """No forces at so many nodes."""
        return cls(np.zeros(nodes), np.zeros((nodes, dim)), np.zeros(nodes, dtype=bool))


def multiplier_spaces(
    data: ProblemData, kept: Kept, mesh: dolfinx.mesh.Mesh
) -> list[fem.FunctionSpace]:
    """The spaces of the multipliers of the sets of strains; collective."""
    return [item.multipliers(data.element, kept, mesh) for item in data.sets]


@dataclass(frozen=True)
class Multipliers:
    """Z in the space of strains, and the forces on each part of Gamma_C.

    ``parts`` has the multiplier y of each set of strains, and Z is the sum of ``L^T y`` over them.
    If the ball is the only set, its multiplier is Z itself, the same function.
    """

    locking_stress: fem.Function
    contacts: tuple[ContactForces, ...]
    parts: tuple[fem.Function, ...]

    @classmethod
    def none(
        cls,
        data: ProblemData,
        spaces: Sequence[fem.FunctionSpace],
        contacts: tuple[ContactForces, ...],
    ) -> Multipliers:
        """No stress, in :func:`multiplier_spaces`, and the given forces on Gamma_C; collective."""
        parts = tuple(fem.Function(space) for space in spaces)
        total = parts[0] if data.only_ball else fem.Function(parts[0].function_space)
        total.name = "locking_stress"
        return cls(total, contacts, parts)

    @classmethod
    def zero(cls, system: PenalisedSystem) -> Multipliers:
        """No stress and no forces; collective."""
        data, mesh = system.data, system.u.function_space.mesh
        forces = (ContactForces.none(len(c.surface.nodes), system.dim) for c in data.contacts)
        return cls.none(data, multiplier_spaces(data, system.kept, mesh), tuple(forces))

    def add_up(self, data: ProblemData) -> None:
        """Make Z the sum of the shares of all sets of strains; collective."""
        if data.only_ball:
            return
        space = self.locking_stress.function_space
        shares = (item.stress(y) for item, y in zip(data.sets, self.parts, strict=True))
        expression = compiled.interpolation(sum(shares), space)
        self.locking_stress.interpolate(expression)
        self.locking_stress.x.scatter_forward()
