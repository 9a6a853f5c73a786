"""The outer fixed point on the friction bound ``g = mu(|u_tau|) |R sigma_nu|``.

The map takes a bound g, solves Tresca's problem, friction under the known bound g, and gives the
bound of its solution.  The map Lambda of Lemma 4.7 takes a traction instead, a vector, and has the
same fixed points but other contraction factors; for eps = 0 it is not defined.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import joint_norm
from contact_locking.errors import NotConverged
from contact_locking.solver.task import Task

# So many updates tell how fast the changes shrink.
_JUDGED = 10


class Unsettled(NotConverged):
    """The friction bound has not settled; ``reached`` is what :func:`fixed_point` returns."""

    def __init__(self, message: str, reached: tuple[float, float | None]) -> None:
        super().__init__(message)
        self.reached = reached


def fixed_point(
    task: Task,
    solve: Callable[[float], None],
    evaluate: Callable[[], list[FloatArray]],
) -> tuple[float, float | None]:
    """Repeat ``g <- mu |R sigma_nu(u(g))|`` until g changes by ``friction_tolerance`` of itself.

    ``solve`` solves under the present bounds, more sharply than the last change that it is given
    (infinity at first), and ``evaluate`` gives the bounds of a solution.  Changes count relative to
    the norm of the bound, or to ``task.least_bound()`` if that is larger.  Afterwards the system
    holds the bound of the last solve.  Returns the last change and the geometric mean of the ratios
    of successive changes.  Raises Unsettled after ``max_friction_updates``, or as soon as the
    changes shrink too slowly to arrive by then.
    """
    settings, counts, bounds = task.settings, task.counts, task.system.bounds
    rubbing = task.system.rubbing
    changes: list[float] = []
    contraction: float | None = None
    for _ in range(settings.max_friction_updates):
        solve(changes[-1] if changes else math.inf)
        new = evaluate()
        size = max(joint_norm(rubbing, new), task.least_bound())
        used = bounds.at(rubbing)
        change = joint_norm(rubbing, [b - a for a, b in zip(used, new, strict=True)])
        relative = change / size if size > 0.0 else change
        changes.append(relative)
        counts.updates += 1
        observed = contraction_factor(changes, settings.friction_tolerance)
        contraction = contraction if observed is None else observed
        task.monitor.friction_update(counts.updates, relative, contraction)
        if relative <= settings.friction_tolerance:
            return relative, contraction
        bounds.enter(rubbing, new)
        if len(changes) > _JUDGED:
            # Changes that go on to shrink as the last ones do should arrive.
            shrunk = (changes[-1] / changes[-1 - _JUDGED]) ** (1.0 / _JUDGED)
            left = settings.max_friction_updates - len(changes)
            if changes[-1] * shrunk**left > settings.friction_tolerance:
                break
    factor = "" if contraction is None else f", contraction factor {contraction:.2f}"
    raise Unsettled(
        f"the friction bound still changes by {changes[-1]:.1e} of itself after "
        f"{len(changes)} updates{factor}",
        (changes[-1], contraction),
    )


def contraction_factor(changes: list[float], floor: float) -> float | None:
    """The geometric mean ratio of successive changes, those below ``floor`` left out.

    The first change is left out too when there are enough: it measures the start, not the map.
    """
    seen = [c for c in changes if c > 0.1 * floor]
    seen = seen[1:] if len(seen) > 3 else seen
    if len(seen) < 2:
        return None
    return float(np.exp(np.mean(np.log(np.divide(seen[1:], seen[:-1])))))
