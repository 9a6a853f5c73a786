"""The outer fixed point on the friction bound ``g = mu(|u_tau|) |R sigma_nu|``.

The map takes a bound g, solves Tresca's problem, friction under the known bound g, and gives the
bound of its solution.  The map Lambda of Lemma 4.7 takes a traction instead, a vector, and has the
same fixed points but other contraction factors; for eps = 0 it is not defined.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from contact_locking.contacts import FrictionBound
from contact_locking.errors import NotConverged
from contact_locking.progress import Monitor
from contact_locking.solver.report import Settings, SolverReport

FloatArray = npt.NDArray[np.float64]


def fixed_point(
    bound: FrictionBound,
    solve: Callable[[], None],
    settings: Settings,
    report: SolverReport,
    monitor: Monitor,
    least: Callable[[], float],
    evaluate: Callable[[], FloatArray] | None = None,
) -> None:
    """Repeat ``g <- mu |R sigma_nu(u(g))|`` until g changes by ``friction_tolerance`` of itself.

    ``solve`` solves for the displacement under the present bound, and ``evaluate`` gives the bound
    of a solution, that of the penalty law by default; changes count relative to the bound's norm,
    or to ``least()`` if that is larger.  Afterwards the forms hold a
    bound that agrees with the displacement to the tolerance, and ``report.contraction`` is the
    geometric mean of the ratios of successive changes.  Raises NotConverged after
    ``max_friction_updates``.
    """
    evaluate = evaluate or bound.evaluate
    changes: list[float] = []
    for update in range(1, settings.max_friction_updates + 1):
        solve()
        new = evaluate()
        size = max(bound.norm(new), least())
        change = bound.norm(new - bound.values)
        relative = change / size if size > 0.0 else change
        bound.values = new
        changes.append(relative)
        report.friction += 1
        report.friction_change = relative
        observed = contraction_factor(changes, settings.friction_tolerance)
        report.contraction = report.contraction if observed is None else observed
        monitor.friction_update(update, relative, report.contraction)
        if relative <= settings.friction_tolerance:
            return
    factor = "" if report.contraction is None else f", contraction factor {report.contraction:.2f}"
    raise NotConverged(
        f"the friction bound still changes by {changes[-1]:.1e} of itself after "
        f"{settings.max_friction_updates} updates{factor}"
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
