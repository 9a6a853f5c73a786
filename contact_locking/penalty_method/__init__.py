"""The penalty method of Bourichi and Essoufi (2016), as printed, for linear elements on simplices.

:mod:`equations` has the forms in the order of the paper, from ``a(., .)`` to (26).  At a frozen
friction bound :mod:`newton` solves (26) by SNES, with steps to a critical point.  Around these
solves :mod:`method` updates the bound ``mu |R sigma_nu|``, a fixed point, and makes n larger stage
by stage.  :func:`require_served` says which problems the method serves; the general solver serves
everything.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from contact_locking.errors import InputError
from contact_locking.problem.discrete_problem import DiscreteProblem


def require_served(problem: DiscreteProblem) -> None:
    """Raise InputError, with its key, for the first thing that the paper does not have."""
    for key, what in _others(problem):
        raise InputError(
            f"{what} is not part of the method of the paper, solver.method: penalty; use auto", key
        )


def _others(problem: DiscreteProblem) -> Iterator[tuple[str, str]]:
    """The keys of what the paper does not have, in words."""
    penalty, element = problem.penalty, problem.element
    if element.boxes:
        yield "mesh.cells", "a mesh of quadrilaterals or hexahedra"
    if element.degree > 1:
        yield "discretisation.degree", "a quadratic displacement"
    if not problem.data.only_ball:
        yield "material.locking", "a limit other than |eps| <= M"
    if problem.free + problem.sliding > 0:
        yield "loads.displacements", "a body held by contact or friction alone"
    if problem.data.own_energy is not None:
        yield "energy", "a user-defined energy"
    if not penalty.n < math.inf:
        yield "penalty.n", "an infinite n"
    for contact in problem.contacts:
        if contact.against:
            yield f"{contact.key}.against", "a second body"
        if contact.is_free:
            yield f"{contact.key}.foundation", "a foundation that a force or a spring moves"
        if not contact.regularisation > 0.0:
            yield contact.concept.friction_key("regularisation"), "friction that is not smooth"
    if not penalty.epsilon > 0.0:
        yield "penalty.epsilon", "contact without a compliance"
