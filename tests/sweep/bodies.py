"""Two bodies that touch each other: stacks and press fits."""

from __future__ import annotations

import math

from .case import (
    Case,
    Random,
    Study,
    Truth,
    between,
    chance,
    clamp,
    decades,
    downwards,
    family,
    pick,
    some_friction,
    some_kernel,
    some_limit,
    strain_size,
    study,
)


@family
def bodies(random: Random) -> Case:
    """Two blocks of different stiffness, or a ring on a disc, either side with the conditions."""
    return _stack(random) if chance(random, 0.7) else _fit(random)


def _stack(random: Random) -> Case:
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    size = strain_size(limit)
    mesh: Study = {
        "builder": "stack",
        "dim": dim,
        "h": pick(random, [0.3, 0.2]) if dim == 2 else 0.5,
        "slope": pick(random, [0.0, 0.0, 0.2]),
    }
    if chance(random, 0.4):
        mesh["upper"] = [between(random, 0.5, 1.4) for _ in range(dim)]
    sides = ["upper_bottom", "lower_top"]
    held = [clamp(dim, "bottom")]
    friction, loads = some_friction(random), Study()
    known: bool | None = True
    if chance(random):
        # The upper block is pushed down, and along if friction and the lower one let it.
        held.append({"on": "top", "value": downwards(random, dim, 0.3 * size)})
        known = None if math.isfinite(limit) else True
    else:
        held.append({"on": "upper_left", "value": [0.0, *[None] * (dim - 1)]})
        if dim == 3:
            held.append({"on": "upper_front", "value": [None, 0.0, None]})
        loads["tractions"] = [{"on": "top", "value": [0.0] * (dim - 1) + [-0.5 * size]}]
    loads["displacements"] = held
    data = study(
        mesh,
        loads,
        poisson=between(random, 0.0, 0.4),
        limit=limit,
        gap=pick(random, [0.0, 0.0, -0.1 * size, 0.05 * size]),
        friction=friction,
        smoothing=some_kernel(random, 0.6),
    )
    swapped = chance(random)
    data["contact"] |= {"on": sides[swapped], "against": sides[not swapped]}
    young = decades(random, -2.0, 2.0)
    other: Study = {"elasticity": {"young": young, "poisson": between(random, 0.0, 0.4)}}
    data["material"]["regions"] = {"lower": other}
    return Case(data, Truth(admissible=known))


def _fit(random: Random) -> Case:
    limit = math.inf if chance(random) else decades(random, -2.0, -1.0)
    overlap = pick(random, [1e-4, 1e-3, 0.01])
    mesh = {"builder": "disc_in_ring", "quarter": True, "hole": pick(random, [None, 0.4]), "h": 0.2}
    planes: list[Study] = [
        {"on": "left", "value": [0.0, None]},
        {"on": "bottom", "value": [None, 0.0]},
    ]
    data = study(
        mesh,
        {"displacements": planes},
        poisson=between(random, 0.0, 0.4),
        limit=limit,
        gap=-overlap,
        friction=some_friction(random),
        smoothing=some_kernel(random, 0.3),
    )
    sides = ["rim", "inner"]
    swapped = chance(random)
    data["contact"] |= {"on": sides[swapped], "against": sides[not swapped]}
    other: Study = {"elasticity": {"young": decades(random, -2.0, 2.0), "poisson": 0.3}}
    data["material"]["regions"] = {"ring": other}
    return Case(data, Truth(admissible=True if math.isinf(limit) else None, touches=True))
