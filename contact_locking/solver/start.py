"""Where the interior point method starts: elastic displacements, from one factorisation."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from contact_locking.solver.cone_system import ConeSystem
from contact_locking.solver.target import Target
from contact_locking.system import ROUNDING

FloatArray = npt.NDArray[np.float64]

# What a linear solve may leave of the forces, while it is not known whether anything is admissible.
_COARSE = 0.03
# A coarse displacement that violates its limits by no more than this share is solved for sharply.
_NEARLY = 0.1
# What an iterative solver leaves of the tolerance.
_LINEAR_SHARE = 0.3
# The loads' part of the displacement is taken by this factor, so that few cells are far beyond
# their limit.
_LOAD_SHARE = 0.001


class ElasticStart:
    """The displacement without multipliers, ``a(u, v) = (f, v)``, and a start made of it.

    Where contact alone holds a rigid motion, springs take the place of the foundation; with
    ``sticks`` they act along it, too.
    """

    def __init__(self, cones: ConeSystem, target: Target, tolerance: float, sticks: bool) -> None:
        self._cones, self._system, self._target = cones, cones.system, target
        self._tolerance, self._sticks = tolerance, sticks
        #: The strain of the elastic displacement, which others are compared with.
        self.strain = 0.0

    def solve(self) -> bool:
        """Put the elastic displacement into the system; True if it is the solution; collective."""
        cones, system = self._cones, self._system
        cones.visit()
        self._set_springs()
        self._moved, self._loaded = cones.elastic_parts(_COARSE, self._push())
        cones.move(1.0, self._moved + self._loaded)
        cones.visit()
        is_solution = not system.held_by_contact and self._is_admissible(_NEARLY)
        if is_solution:
            zeros = np.zeros_like(cones.strains(system.u.x.array))
            accuracy = _LINEAR_SHARE * self._tolerance
            cones.move(1.0, cones.solve_step(zeros, None, None, accuracy))
            cones.visit()
            is_solution = self._is_admissible(0.0)
        self.strain = self._size()
        return is_solution

    def retreat(self) -> float:
        """Take back most of what the loads do; returns the strain of the rest; collective."""
        cones = self._cones
        cones.move(_LOAD_SHARE - 1.0, self._loaded)
        cones.visit()
        return max(self._size(), _LOAD_SHARE * self.strain)

    def _size(self) -> float:
        """The mean strain, or that which takes back how far the body enters the foundation."""
        strain = self._target.mean_strain(self._cones.energy, 0.0, self._tolerance)
        return max(strain, self._entered() / self._target.length)

    def _set_springs(self) -> None:
        cones, count = self._cones, len(self._cones.limit)
        nothing = np.zeros(count), np.zeros(count), np.zeros((cones.rows, count))
        self._springs = None
        if cones.surface is None:
            cones.set_scaling(nothing, None, None)
            return
        nodes = len(cones.node_gap)
        springs = np.zeros(nodes)
        if self._system.held_by_contact:
            springs[:] = self._target.ellipticity / self._target.length
            self._springs = springs
        along = springs if self._sticks else np.zeros(nodes)
        cones.set_scaling(nothing, springs, (along, np.zeros(nodes), np.zeros((cones.dim, nodes))))

    def _push(self) -> FloatArray | None:
        """The pressure of springs that rest where the body comes to rest on the foundation.

        That is the foundation itself inside the body, and the nearest of it outside.
        """
        if self._springs is None:
            return None
        gap = self._cones.node_gap
        nearest = float(np.min(gap, initial=np.inf))
        nearest = max(self._cones.comm.allreduce(nearest, op=MPI.MIN), 0.0)
        return -self._springs * np.minimum(gap, nearest)

    def _is_admissible(self, margin: float) -> bool:
        """Whether strains and openings keep their limits, but for a share of them; collective."""
        cones = self._cones
        displacement = self._system.u.x.array
        strain = np.linalg.norm(cones.strains(displacement), axis=0)
        keeps = bool(np.all(strain <= cones.limit * (1.0 + margin + ROUNDING)))
        if cones.surface is not None:
            normal = cones.normal_displacements(displacement)
            size = margin * np.abs(normal) + ROUNDING * cones.largest_displacement()
            size += ROUNDING * np.abs(cones.node_gap)
            keeps = keeps and bool(np.all(normal - cones.node_gap <= size))
        return bool(cones.comm.allreduce(keeps, op=MPI.LAND))

    def _entered(self) -> float:
        """The deepest penetration, 0 where there is none; collective."""
        cones = self._cones
        if cones.surface is None:
            return 0.0
        depth = cones.normal_displacements(self._system.u.x.array) - cones.node_gap
        return float(cones.comm.allreduce(float(np.max(depth, initial=0.0)), op=MPI.MAX))
