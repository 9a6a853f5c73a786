"""The equations of the last iterate, and how they change with the data of a problem.

    equilibrium     a(u, .) + int reactions . lin(.) - (f, .) = 0
    travels         int reactions . m + F - k q = 0
    points          x = (M + z_0/2n, L eps(u)),  g + eps p - u_nu,  (t, u_tau - u_{k-1,tau}, delta)
    bounds          G = mu(|u_tau|) |R p|

Data change what these equations leave at an iterate that stands still: that is all that is ever
evaluated of them.  No law is differentiated by a parameter here.

At a point of a cone one of the two, the point or its multiplier, is away from the end of its cone:
a gap is open or a pressure acts, a strain is below its limit or a locking stress acts, a slip is
there or friction is below its bound.  Where both are at the end, as where a body just touches, the
state changes with the data, and the two sides of the change have derivatives of their own.

Points of the central path are inside of their cones.  One whose room, times the stiffness of the
body, is not small beside its force, nor large, is near a change as well: its state is not told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import InputError
from contact_locking.parallel import maximum
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.bound_step import MovingBound
from contact_locking.solver.interior_point.contact_cones import (
    ContactCones,
    FrictionCones,
    OnContact,
)
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.iterate import Families, families_of
from contact_locking.solver.interior_point.locking_cones import LimitsOfStrain
from contact_locking.solver.interior_point.lorentz import norm
from contact_locking.solver.task import SavedState, Target

# At the last iterate the equations hold to the tolerance of the solver, but for points near a
# change of their state, which were moved inside their cones.  Data that have changed since the
# solve leave more than this share of forces and points.  The smooth laws that stand for penalties
# leave more of the forces, too, near a kink of a law.
_POINTS, _FORCES = 1e-4, 1e-3
_CHANGED = (
    "the data have changed since the solve: solve again, or ask for derivatives before the data "
    "change"
)
# A point is near a change where both are below this share of the largest, or of the limit.
_NEAR = 1e-3
# The state of a point is told where room and force, in units of the body, are so far apart.
_TOLD = 1e-4


@dataclass(frozen=True)
class Residual:
    """The residual: forces on owned dofs and along travels, and gaps of the points.

    ``free`` are the forces without their part along what is held at present: with the direction of
    a support, the part of its reaction that is free changes.  ``gaps`` has an array for each family
    that takes part, and ``bounds`` one for each friction bound.  ``values`` are quantities at the
    iterate.
    """

    forces: FloatArray
    free: FloatArray
    gaps: tuple[FloatArray, ...]
    bounds: tuple[FloatArray, ...]
    values: FloatArray

    def per(self, other: Residual, width: float) -> Residual:
        """How much this is more than another one, over the width between them."""

        def rate(mine: FloatArray, others: FloatArray) -> FloatArray:
            return np.asarray((mine - others) / width)

        return Residual(
            rate(self.forces, other.forces),
            rate(self.free, other.free),
            tuple(map(rate, self.gaps, other.gaps)),
            tuple(map(rate, self.bounds, other.bounds)),
            rate(self.values, other.values),
        )


class Equations:
    """The equations of a system for its present data, at an iterate that stands still.

    Displacements at held dofs are those that the data prescribe.  Those of ``every`` family that
    take part are the ``families``.  The constructor is collective.  Raises InputError for laws
    whose derivatives are not known.
    """

    def __init__(self, system: System, target: Target, iterate: SavedState) -> None:
        if system.data.own_energy is not None:
            raise InputError("there are no derivatives with a user-defined energy", "energy")
        for contact in system.rubbing:
            if not contact.friction.is_coulomb:
                raise InputError(
                    "there are no derivatives with a user-defined friction bound", contact.key
                )
        self.system, self.target = system, target
        self._owned = len(system.load)
        self._all: Families = families_of(system, target, 0.0)
        self.every = self._all.every
        held = system.constraints.free_part(iterate.displacement)
        system.u.x.array[:] = held
        system.constraints.apply(system.u)
        system.tools.travels = iterate.travels
        self.families: list[Family] = []
        if len(self.every) != len(iterate.cones):
            raise InputError("the laws of contact and friction are others with these data")
        for family, cones in zip(self.every, iterate.cones, strict=True):
            family.takes_part = cones is not None
            family.update(self.displacement)
            if cones is not None:
                family.x, family.z = family.centred(*cones)
                self.families.append(family)
        self.bounds = [bound for bound in self._all.bounds if bound.friction.takes_part]

    @property
    def displacement(self) -> FloatArray:
        """The owned values, and zeros for travels, which the gaps contain."""
        return np.append(self.system.u.x.array[: self._owned], np.zeros(len(self.system.tools)))

    def residual(self) -> Residual:
        """The residual of the equations, without quantities; collective."""
        system, comm = self.system, self.system.comm
        vector = system.u.x.petsc_vec.duplicate()
        vector.array_w[:] = system.forms.elastic_forces(system.u)[: self._owned] - system.load
        on_tools = np.zeros(len(system.tools))
        for family in self.families:
            family.add_forces(family.reactions, vector)
            family.add_tool_forces(family.reactions, on_tools)
        travels = comm.allreduce(on_tools) - system.tools.unbalanced
        forces = np.append(vector.array_r, travels)
        free = np.append(system.constraints.free_part(vector.array_r), travels)
        vector.destroy()
        bounds = [self._required(bound) - bound.friction.bound for bound in self.bounds]
        gaps = tuple(family.primal_gap() for family in self.families)
        return Residual(forces, free, gaps, tuple(bounds), np.empty(0))

    def _required(self, bound: MovingBound) -> FloatArray:
        """``mu(s) |R p|`` (k,) with the slip of the points, whose gaps move them; collective."""
        contact, nodes, points = bound.contact, bound.friction.nodes, bound.friction.x
        slips = contact.slips(self.system.u)
        nodes.scatter(nodes.of_all(contact.state.slip) + norm(points[1 : 1 + nodes.dim]), slips)
        pressure = nodes.at_all(bound.pressing.z)
        return nodes.of_all(contact.rubbing(contact.friction.evaluate(pressure, slips)))

    def close(self) -> None:
        """Free the PETSc objects; collective."""
        self._all.destroy()


def require_solved(equations: Equations) -> None:
    """Raise InputError if the equations do not hold at their iterate; collective."""
    residual, system = equations.residual(), equations.system
    forces = residual.free[: len(system.load)]
    force = float(np.sqrt(system.comm.allreduce(float(forces @ forces))))
    holds = force <= _FORCES * system.force_scale(1.0)
    moved = system.largest_displacement()
    target = equations.target
    stress = target.ellipticity * target.mean_strain(system.energy(), moved, 1.0)
    for family, gap in zip(equations.families, residual.gaps, strict=True):
        if isinstance(family, FrictionCones):
            # Slips under a bound that is nothing beside the stress are left open by the solver.
            gap = gap * np.minimum(1.0, family.bound / stress if stress > 0.0 else 0.0)
        size = maximum(system.comm, family.x, moved if isinstance(family, OnContact) else 0.0)
        holds &= maximum(system.comm, np.abs(gap)) <= _POINTS * size
    if not holds:
        raise InputError(_CHANGED)


def share_at_change(equations: Equations) -> dict[str, float]:
    """The share of the points of "strain", "contact" and "friction" near a change; collective."""
    young, comm = equations.target.young, equations.system.comm
    counts: dict[str, FloatArray] = {}
    for family in equations.every:
        kind, near = _judged(family, young / family.scale, comm)
        size = np.array([family.weights[near].sum(), family.weights.sum()])
        counts[kind] = counts.get(kind, np.zeros(2)) + comm.allreduce(size)
    return {
        kind: float(near / every) if every > 0.0 else 0.0 for kind, (near, every) in counts.items()
    }


def _judged(family: Family, stiffness: float, comm: MPI.Intracomm) -> tuple[str, BoolArray]:
    """The kind of a family, and its points near a change; collective."""

    def undecided(room: FloatArray, force: FloatArray) -> BoolArray:
        """Where neither of two stresses is small beside the other."""
        return np.asarray(np.minimum(room, force) > _TOLD * np.maximum(room, force))

    if isinstance(family, FrictionCones):
        if not family.takes_part:
            return "friction", np.zeros(len(family.weights), dtype=bool)
        slip, bound = norm(family.x[1:]), family.bound
        reserve = bound - norm(family.z[1:])
        holds = bound > _NEAR * maximum(comm, bound)
        near = (slip <= _NEAR * maximum(comm, slip)) & (reserve <= _NEAR * bound)
        return "friction", np.asarray(holds & (near | undecided(stiffness * slip, reserve)))
    kind = "contact" if isinstance(family, ContactCones) else "strain"
    if not family.takes_part:
        # The multipliers of an elastic solution are zero; these points are nearly reached.
        if isinstance(family, ContactCones):
            size = maximum(comm, np.append(np.abs(family.seen), 0.0))
            return kind, np.asarray(family.limit - family.seen <= _NEAR * size)
        assert isinstance(family, LimitsOfStrain)
        return kind, np.asarray(family.limit - family.reach <= _NEAR * family.limit)
    if family.x.ndim == 1:
        room, force, size = family.x, family.z, maximum(comm, np.abs(family.seen))
    else:
        room, force, size = family.x[0] - norm(family.x[1:]), family.z[0], family.x[0]
    near = (room <= _NEAR * size) & (force <= _NEAR * maximum(comm, force))
    return kind, np.asarray(near | undecided(stiffness * room, force))
