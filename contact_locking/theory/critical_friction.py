"""The share of friction at which the linearised problem at a solution becomes singular."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.contact.smoothing import Identity
from contact_locking.errors import NotConverged
from contact_locking.parallel import maximum, minimum
from contact_locking.results.contact_points import OPEN
from contact_locking.solver.task import Counts, Task
from contact_locking.theory.equilibria.bound_map import BoundMap
from contact_locking.theory.equilibria.search import has_map

# An eigenvalue counts as real whose imaginary part is a smaller share of it, and as none that is a
# smaller share of the norm: the derivative comes from the end of a central path.
_REAL, _NONE = 1e-8, 1e-6


def critical_friction(state: SolvedState) -> dict[str, Any]:
    """``min {t > 0: I - t Phi'(G) is singular}`` at the bounds G of a solution; collective.

    Phi is the map of :mod:`contact_locking.theory.equilibria.bound_map`, for the coefficient mu.
    With ``t mu`` in the place of mu, and the same points that stick, slip and are open, the
    linearised problem has more than one solution: the eigenvalue problem of Hassani, Hild,
    Ionescu and Sakki (doi:10.1016/S0045-7825(03)00419-5).  ``share`` is t, None if no t is
    critical; ``coefficient`` is ``t mu``, None also where mu is not the same everywhere and at
    every slip.  ``mode_peak`` is the place where the bound of the eigenvector is largest.
    """
    none: dict[str, Any] = dict.fromkeys(("share", "coefficient", "mode_peak"))
    task = Task(state.system, state.target, state.settings).aside(Counts())
    if not has_map(task):
        return {
            **none,
            "reason": "there is no friction with a coefficient, friction alone holds the body, or "
            "Gamma_C has too many nodes",
        }
    with state.system.preserved():
        problem = BoundMap(task)
        try:
            vectors = problem.vectors
            problem(vectors.in_force())
            found = critical_share(_of_laws(problem, state))
        except NotConverged as failure:
            return {**none, "reason": str(failure)}
        finally:
            problem.destroy()
    found = state.comm.bcast(found)
    if found is None:
        return {**none, "reason": "no share of friction is critical for this state of the contact"}
    share, mode = found
    parts = [contact.surface.points[contact.free] for contact in vectors.contacts]
    coordinates = zip(*(part.T for part in parts), strict=True)
    places = np.stack([vectors.join(list(values)) for values in coordinates], axis=1)
    values = np.concatenate(
        [item.friction.coefficient(np.zeros(len(item.free))) for item in state.system.rubbing]
    )
    mu, smallest = maximum(state.comm, values), minimum(state.comm, values)
    falls = any(contact.friction.depends_on_slip for contact in state.system.rubbing)
    return {
        "share": share,
        "coefficient": None if falls or mu != smallest else share * mu,
        "mode_peak": places[int(np.argmax(np.abs(mode)))].tolist(),
    }


def _of_laws(problem: BoundMap, state: SolvedState) -> FloatArray:
    """``Phi'`` (m, m) at the last value, without what a central path leaves; collective.

    A node that sticks answers no change of its bound, and an open node without a smoothing R has
    no bound, whatever the bounds of the others are.
    """
    vectors = problem.vectors
    found = [item for item in state.contacts if item.contact in vectors.contacts]
    answers = vectors.gather([np.where(item.holds, 0.0, 1.0) for item in found])
    has_bound = []
    for item in found:
        is_local = isinstance(item.contact.friction.smoothing, Identity)
        has_bound.append(np.where(is_local & (item.state == OPEN), 0.0, 1.0))
    return vectors.gather(has_bound)[:, None] * problem.derivative() * answers


def critical_share(derivative: FloatArray) -> tuple[float, FloatArray] | None:
    """The least t > 0 with ``I - t J`` singular, for J (m, m), and the eigenvector; None without.

    t is one over the largest of the positive eigenvalues of J.
    """
    values, vectors = np.linalg.eig(derivative)
    least = _NONE * float(np.linalg.norm(derivative))
    is_real = (np.abs(values.imag) <= _REAL * np.abs(values)) & (values.real > least)
    if not np.any(is_real):
        return None
    place = int(np.argmax(np.where(is_real, values.real, -math.inf)))
    return 1.0 / float(values[place].real), np.real(vectors[:, place])
