"""Solves for several tests of the certificate."""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl
from mpi4py import MPI
from problems import solved

from contact_locking.fem.compiled import integral
from contact_locking.laws.body import strain
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters


def certificate(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> dict[str, Any]:
    return dict(solved(parameters, comm).summary["certificate"])


def work_of_stored_forces(solution: StudySolution, dx: ufl.Measure) -> float:
    """The work of stresses and contact forces on the displacement; ``dx`` is for locking."""
    work = 2.0 * solution.summary["elastic_energy"]
    eps = strain(solution.displacement)
    work += integral(solution.domain, ufl.inner(solution.locking_stress, eps) * dx)
    (contact,) = solution.contacts
    forces = contact.traction - contact.pressure[:, None] * contact.normal
    path = contact.u_tangent + contact.u_normal[:, None] * contact.normal
    return work - float(contact.surface.integral(np.sum(forces * path, axis=1)))
