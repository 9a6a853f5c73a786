"""Families of bodies that friction holds: strips that are lifted, and large coefficients."""

from __future__ import annotations

from .case import Case, Random, Truth, between, chance, decades, family, pick, study


@family
def lifted(random: Random) -> Case:
    """A thin strip on a floor, lifted at one end, which friction or a roller holds along the floor.

    The strip is heavier than what lifts it, so that a part of the strip stays on the floor.
    """
    thickness, young = decades(random, -3.0, 2.0), decades(random, 0.0, 11.0)
    slenderness = pick(random, [10, 20, 40, 80])
    length, weight = slenderness * thickness, young * decades(random, -9.0, -5.0) / slenderness
    # A beam of this stiffness is lifted over the share s of its length by the height h.
    share = between(random, 0.3, 0.8)
    height = weight * thickness * (share * length) ** 4 / (2.0 * young * thickness**3)
    lift = {"on": "right", "value": [None, height]}
    roller = {"on": "left", "value": [0.0, None]}
    by_friction = chance(random, 0.7)
    data = study(
        {
            "builder": "block",
            "dim": 2,
            "size": [length, thickness],
            "h": thickness,
            "structured": True,
        },
        {
            "body_force": [0.0, -weight],
            "displacements": [lift] if by_friction else [lift, roller],
        },
        young=young,
        friction=between(random, 0.05, 0.8) if by_friction else 0.0,
        smoothing={"kernel": pick(random, ["none", "convolution"]), "radius": 3.0 * thickness},
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def sticky(random: Random) -> Case:
    """A block under a plate that is pressed on a floor with a coefficient up to a million."""
    width, press = between(random, 1.0, 4.0), between(random, 0.002, 0.05)
    data = study(
        {
            "builder": "block",
            "dim": 2,
            "size": [width, 1.0],
            "h": pick(random, [0.25, 0.2]),
            "structured": chance(random),
        },
        {"displacements": [{"on": "top", "value": [0.0, -press]}]},
        poisson=pick(random, [0.0, 0.3, 0.45, 0.49]),
        friction=decades(random, 1.0, 6.0),
        smoothing={"kernel": pick(random, ["none", "convolution", "helmholtz"]), "radius": 0.5},
    )
    return Case(data, Truth(admissible=True, touches=True))
