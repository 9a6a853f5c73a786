"""The fixed point of the friction bound, ``G = mu(|u_tau|) |R sigma_nu(u(G))|``, and its factor.

The map takes a bound G, solves Tresca's problem, which is friction under the known bound G, and
gives the bound of the solution.  The map Lambda of Lemma 4.7 takes a traction, a vector, in its
place; it has the same fixed points but other contraction factors, and is not defined for delta = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from contact_locking.contact.nodal_contact import joint_norm
from contact_locking.errors import NotConverged
from contact_locking.penalty_method.equations import Equations
from contact_locking.solver.task import Task


def fixed_point(
    task: Task, equations: Equations, solve: Callable[[float], None]
) -> tuple[float, float | None]:
    """Repeat ``G <- mu |R sigma_nu(u(G))|`` until G changes by ``friction_tolerance`` of itself.

    ``solve`` solves (26) under the present bound, more sharply than the last change that it is
    passed, which is infinite at first.  Changes count relative to the norm of the bound, or to
    ``task.least_bound()`` if that is larger.  Afterwards the system holds the bound of the last
    solve.  Returns the last change and the geometric mean of the ratios of successive changes, the
    contraction factor.  Raises NotConverged after ``max_friction_updates``.
    """
    settings, counts, bounds = task.settings, task.counts, task.system.bounds
    rubbing, changes = task.system.rubbing, list[float]()
    contraction: float | None = None
    for _ in range(settings.max_friction_updates):
        solve(changes[-1] if changes else math.inf)
        used, new = bounds.at(rubbing), equations.friction_bounds()
        size = max(joint_norm(rubbing, new), task.least_bound())
        change = joint_norm(rubbing, [b - a for a, b in zip(used, new, strict=True)])
        changes.append(change / size if size > 0.0 else change)
        counts.updates += 1
        observed = contraction_factor(changes, settings.friction_tolerance)
        contraction = contraction if observed is None else observed
        task.monitor.friction_update(counts.updates, changes[-1], contraction)
        if changes[-1] <= settings.friction_tolerance:
            return changes[-1], contraction
        bounds.set(rubbing, new)
    factor = "" if contraction is None else f", contraction factor {contraction:.2f}"
    raise NotConverged(
        f"the friction bound still changes by {changes[-1]:.1e} of itself after "
        f"{len(changes)} updates{factor}"
    )


def contraction_factor(changes: list[float], floor: float) -> float | None:
    """The geometric mean ratio of successive changes, without those that are far below ``floor``.

    The first change is left out too if there are enough: it measures the start, not the map.
    """
    seen = [change for change in changes if change > 0.1 * floor]
    seen = seen[1:] if len(seen) > 3 else seen
    if len(seen) < 2:
        return None
    return float(np.exp(np.mean(np.log(np.divide(seen[1:], seen[:-1])))))
