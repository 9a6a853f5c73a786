"""The measures that judge the convergence of the interior point method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.solver.task import Settings


@dataclass
class Measures:
    """The measures of convergence, all relative."""

    equilibrium: float
    primal: float
    gap: float
    friction: float

    def __str__(self) -> str:
        return (
            f"equilibrium {self.equilibrium:.1e}, laws {self.primal:.1e}, "
            f"duality gap {self.gap:.1e}, friction bound {self.friction:.1e}"
        )

    def worst(self) -> float:
        return max(self.equilibrium, self.primal, self.gap, self.friction)

    def reached(self, settings: Settings, gap: float, loosened: float = 1.0) -> bool:
        """Whether all are within ``loosened`` times the tolerances, the duality gap of ``gap``."""
        return (
            self.equilibrium <= loosened * settings.tolerance
            and self.primal <= loosened * settings.tolerance
            and self.gap <= loosened * gap
            and self.friction <= loosened * settings.friction_tolerance
        )


def relative_rms(
    comm: MPI.Intracomm, weights: FloatArray, values: FloatArray, scale: FloatArray
) -> float:
    """``|values|/|scale|`` in the weighted L2 norm, columns being vectors; collective."""

    def square(a: FloatArray) -> float:
        return float(weights @ (a**2 if a.ndim == 1 else np.sum(a**2, axis=0)))

    total, size = comm.allreduce(np.array([square(values), square(scale)]))
    return float(np.sqrt(total / size)) if size > 0.0 else 0.0
