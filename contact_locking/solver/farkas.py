"""A proof by Farkas's lemma that no displacement of the mesh is admissible."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from contact_locking.solver.cone_point import ConePoint
from contact_locking.solver.cone_system import ConeSystem
from contact_locking.solver.target import Target

FloatArray = npt.NDArray[np.float64]

# Multipliers are balanced by a stress this many times stiffer than the material.
_STIFFER = 1e6
# Cells without a limit are taken to strain no more than this: small strains are the model's.
_SMALL_STRAIN = 1.0
# What rounding may add to either side, relative to it.
_ROUNDING = 1e-6
# The linear solve of an iterative solver leaves this share of the imbalance.
_ACCURACY = 1e-8


def excluded_factor(point: ConePoint, target: Target) -> float | None:
    """The least factor on the prescribed values u_D that the multipliers prove impossible.

    Let ``B(v) = int Z : eps(v) + int p v_nu`` for any Z and ``p >= 0``.  If B vanishes for every v
    that is zero where displacements are prescribed, then ``P = B(u)`` is the same for every field
    that follows u_D, and s P for those that follow s u_D; but it is ``R = int M |Z| + int p gap``
    at most where ``|eps| <= M`` and ``u_nu <= gap``.  So no admissible field on this mesh follows
    s u_D with ``s > R/P``.

    The multipliers of ``point`` hardly balance each other.  With

        int (A + k) eps(rho) : eps(v) + int (k/L) rho_nu v_nu = B(v)

    ``Z - k eps(rho)`` and ``p - (k/L) rho_nu`` do, but for ``a(rho, v)``, which adds at most
    ``int c |eps(rho)| (M + |eps(u)|)`` to R, c being the largest eigenvalue of A.  Where nothing
    limits the strain 1 takes the place of M.

    None without a proof that ``P > R``, and where friction alone holds the body, so that rho is not
    determined.  Infinite if R is negative: then the gap alone is in the way, and to scale u_D is
    no way out.  Collective.
    """
    cones = point.cones
    pressure = None if point.contact is None else point.contact.z
    if cones.system.held_by_friction or not _may_exclude(point, pressure):
        return None
    stiffness = _STIFFER * target.stiffness
    springs = None
    if pressure is not None:
        held = cones.system.held_by_contact
        springs = np.full(len(pressure), stiffness / target.length if held else 0.0)
    rho = _balance(cones, point.locking.stress, pressure, stiffness, springs)
    stress = point.locking.stress - stiffness * cones.strains(rho)
    if pressure is not None and springs is not None:
        pressure = pressure - springs * cones.normal_displacements(rho)
        negative = bool(np.any(pressure < 0.0))
        if cones.comm.allreduce(negative, op=MPI.LOR):
            return None
    power = cones.power(cones.system.u.x.array, stress, pressure)
    resistance = cones.resistance(stress, pressure)
    resistance += cones.work_beyond(rho, _SMALL_STRAIN)
    if power - resistance <= _ROUNDING * (abs(power) + abs(resistance)):
        return None
    return resistance / power if resistance > 0.0 else math.inf


def _may_exclude(point: ConePoint, pressure: FloatArray | None) -> bool:
    """Whether the multipliers exclude anything if they are taken as they are; collective."""
    cones, stress = point.cones, point.locking.stress
    power = cones.power(cones.system.u.x.array, stress, pressure)
    return cones.resistance(stress, pressure) < power


def _balance(
    cones: ConeSystem,
    stress: FloatArray,
    pressure: FloatArray | None,
    stiffness: float,
    springs: FloatArray | None,
) -> FloatArray:
    """The field rho (owned values); leaves the tangent of the system changed."""
    count = len(cones.limit)
    stiff = np.full(count, stiffness), np.zeros(count), np.zeros((cones.rows, count))
    nothing = None
    if springs is not None:
        zeros = np.zeros(len(springs))
        nothing = zeros, zeros, np.zeros((cones.dim, len(springs)))
    cones.set_scaling(stiff, springs, nothing)
    return cones.balance(stress, pressure, _ACCURACY)
