"""Families of materials and their limits."""

from __future__ import annotations

import math

import numpy as np

from .case import Case, Random, Study, Truth, clamp, down, family, strain_size, study


def _pressed(random: Random, mesh: Study, limit: float | str, **more: object) -> Case:
    dim = mesh["dim"]
    size = strain_size(limit if isinstance(limit, float) else 0.02)
    data = study(
        mesh,
        random.held_and_pressed(dim, size * random.between(0.2, 2.0)),
        limit=limit,
        gap=random.pick([0.0, 0.1 * size]),
        friction=random.friction(),
        smoothing=random.kernel(),
        **more,  # type: ignore[arg-type]
    )
    return Case(data, Truth(admissible=True))


@family
def slender_beam(random: Random) -> Case:
    """A cantilever, 10 to 40 times as long as thick, above its foundation or on it."""
    dim, length = random.pick([2, 2, 3]), random.pick([10.0, 20.0, 40.0])
    mesh = random.block([length, *[1.0] * (dim - 1)], 1.0 if dim == 3 else 0.5)
    limit = random.limit()
    load = strain_size(limit) / length**2 * random.decades(-0.5, 1.0)
    loads = {
        "tractions": [{"on": "top", "value": random.downwards(dim, load)}],
        "displacements": [clamp(dim)],
    }
    data = random.rubbing(mesh, loads, limit=limit, gap=random.pick([0.0, 0.1]), radius=[1.0, 4.0])
    return Case(data, Truth(admissible=True))


@family
def tower(random: Random) -> Case:
    """A tower, clamped along one side or carried by the foundation alone."""
    height = random.pick([5.0, 10.0, 20.0])
    mesh = random.block([1.0, height], random.pick([0.3, 0.5]))
    limit = random.limit()
    size = strain_size(limit)
    sides = random.chance(0.7)
    held = clamp(2) if sides else {"on": "left", "value": [0.0, None]}
    pressure = size * random.between(0.1, 1.0)
    value = random.downwards(2, pressure) if sides else down(2, pressure)
    loads = {"displacements": [held], "tractions": [{"on": "top", "value": value}]}
    data = random.rubbing(
        mesh,
        loads,
        poisson=random.pick([0.3, 0.4999]),
        limit=limit,
        gap=random.pick([0.0, size]),
        radius=[0.3, 1.0],
    )
    return Case(data, Truth(admissible=True))


@family
def incompressible(random: Random) -> Case:
    """Poisson's ratio from 0.49 to 0.499999."""
    poisson = 0.5 - random.decades(-6.0, -2.0)
    mesh = random.unit_block(random.pick([2, 2, 3]))
    return _pressed(random, mesh, random.limit(), poisson=poisson)


@family
def auxetic(random: Random) -> Case:
    """Poisson's ratio from -0.95 to 0."""
    mesh = random.unit_block(random.pick([2, 2, 3]))
    return _pressed(random, mesh, random.limit(), poisson=random.between(-0.95, 0.0))


@family
def contrast(random: Random) -> Case:
    """An inclusion 1e-8 to 1e8 times as stiff as the body, with the same limit or another."""
    mesh = {"builder": "inclusion", "dim": 2, "h": random.pick([0.12, 0.15])}
    limit = random.limit()
    case = _pressed(random, mesh, limit)
    inclusion: Study = {"elasticity": {"young": random.decades(-8.0, 8.0), "poisson": 0.3}}
    if random.chance():
        inclusion["locking_limit"] = random.pick([math.inf, 0.3 * strain_size(limit)])
    case.study["material"]["regions"] = {"inclusion": inclusion}
    return case


@family
def limit_in_space(random: Random) -> Case:
    """M that varies, jumps by orders, or is tiny in a layer at the clamp."""
    small = random.decades(-7.0, -2.0)
    law = random.pick(
        [
            f"{small} if x < 0.31 else 0.05",
            "0.01 + 0.05*x",
            f"{small} if y < 0.37 else inf",
            f"inf if x < 0.47 else {small}",
            "0.02*exp(-5*x)",
        ]
    )
    return _pressed(random, random.unit_block(random.pick([2, 2, 3])), law)


@family
def heated(random: Random) -> Case:
    """Heat, or strains along the axes, in the body or its inclusion; on springs or clamped."""
    dim, limit, size = random.body()
    core = dim == 2 and random.chance(0.3)
    mesh = {"builder": "inclusion", "dim": 2, "h": 0.15} if core else random.unit_block(dim)
    case = _pressed(random, mesh, limit, poisson=random.pick([0.0, 0.3, 0.45]))
    strain = size * random.between(-2.0, 2.0)
    kinds: list[Study] = [
        {"value": strain},
        {"value": f"{strain}*(1 - 2*y)"},
        {"value": random.vector(dim, size)},
        {"expansion": 1e-5, "temperature": f"{1e5 * strain}*x"},
    ]
    chosen: Study = dict(random.pick(kinds))
    given = [chosen | {"on": "inclusion"} if core else chosen]
    if random.chance(0.3):
        given.append({"value": random.vector(dim, 0.3 * size)})
    case.study["material"]["eigenstrain"] = given
    loads = case.study["loads"]
    if random.chance(0.6):
        beds: list[Study] = [
            {"on": "right", "stiffness": random.decades(-2.0, 2.0)},
            {"on": "top", "stiffness": random.decades(-2.0, 2.0), "along": "normal"},
            {
                "on": "right",
                "stiffness": random.decades(-1.0, 1.0),
                "along": random.vector(dim, 1.0),
            },
        ]
        loads["springs"] = [random.pick(beds)]
        if random.chance():
            del loads["displacements"]
            loads["springs"].append({"on": "left", "stiffness": random.decades(-1.0, 2.0)})
    return case


@family
def anisotropic(random: Random) -> Case:
    """A random elliptic matrix in Mandel's notation."""
    dim = random.pick([2, 2, 3])
    count = dim * (dim + 1) // 2
    frame = np.linalg.qr(random.standard_normal((count, count)))[0]
    eigenvalues = 10.0 ** random.uniform(-1.0, 1.0, count)
    matrix = np.round(frame @ np.diag(eigenvalues) @ frame.T, 6)
    case = _pressed(random, random.unit_block(dim), random.limit())
    stiffness = np.triu(matrix) + np.triu(matrix, 1).T
    case.study["material"]["elasticity"] = {"stiffness": stiffness.tolist()}
    return case


@family
def stiffness_in_space(random: Random) -> Case:
    """Young's modulus that varies or jumps in the body."""
    law = random.pick(["1 + 9*x", "exp(6*y)", "1e4 if y > 0.47 else 1", "1 if x > 0.37 else 1e-3"])
    mesh = random.unit_block(random.pick([2, 2, 3]))
    return _pressed(random, mesh, random.limit(), young=law)


@family
def penalties(random: Random) -> Case:
    """Finite n and epsilon, each by itself, from 1e-3 to 1e10 of what has their unit."""
    dim, young = random.pick([2, 2, 3]), random.pick([1.0, 1.0, 2.1e11, 1e-6])
    n: float = random.pick([math.inf, young * random.decades(-3.0, 10.0)])
    penalty: Study = {"n": n}
    if random.chance(0.7):
        penalty["epsilon"] = random.decades(-10.0, 1.0) / young
    elif math.isinf(n):
        penalty["n"] = young * random.decades(-3.0, 10.0)
    limit = random.limit()
    size = strain_size(limit)
    data = study(
        random.unit_block(dim),
        random.held_and_pressed(dim, young * size * random.between(0.2, 2.0)),
        young=young,
        limit=limit,
        gap=random.pick([0.0, 0.1 * size]),
        friction=random.friction(),
        smoothing=random.kernel(),
        penalty=penalty,
    )
    return Case(data, Truth(admissible=True))


@family
def huge_load(random: Random) -> Case:
    """Loads up to 1e7 times those that make the body lock: nearly all of it is rigid."""
    dim, limit = random.pick([2, 2, 3]), random.decades(-5.0, -1.0)
    pressure = limit * random.decades(1.0, 7.0)
    loads = {
        "tractions": [{"on": "top", "value": random.downwards(dim, pressure)}],
        "displacements": [clamp(dim)],
    }
    data = random.rubbing(
        random.unit_block(dim), loads, limit=limit, gap=random.pick([0.0, 0.1 * limit])
    )
    return Case(data, Truth(admissible=True))


@family
def rest_admissible(random: Random) -> Case:
    """Large loads where u = 0 is within limit and gap: never infeasible."""
    limit = random.decades(-4.5, -1.5)
    kind = random.pick(["rollers", "tower", "inclusion", "block"])
    load = limit * random.decades(-0.5, 2.0)
    value = [random.between(-1.0, 1.0) * load, -load]
    displacements: list[Study] = [clamp(2)]
    mesh = random.unit_block(2)
    if kind == "rollers":
        displacements = [{"on": ["left", "right"], "value": [0.0, None]}]
        value[0] = 0.0
    elif kind == "tower":
        mesh = random.block([1.0, 5.0], 0.3)
    elif kind == "inclusion":
        mesh = {"builder": "inclusion", "dim": 2, "h": 0.15}
    data = random.rubbing(
        mesh,
        {"tractions": [{"on": "top", "value": value}], "displacements": displacements},
        poisson=random.pick([0.3, 0.4999]),
        limit=limit,
        gap=random.pick([0.0, 0.1 * limit, limit, 1.0]),
    )
    if kind == "inclusion":
        stiff: Study = {"elasticity": {"young": random.decades(1.0, 4.0), "poisson": 0.3}}
        data["material"]["regions"] = {"inclusion": stiff}
    return Case(data, Truth(admissible=True))


@family
def impossible(random: Random) -> Case:
    """The ends pulled apart by more than the limit allows any path between them."""
    dim, limit = random.pick([2, 2, 3]), random.decades(-4.0, -1.0)
    apart = random.vector(dim, 0.3 * limit)
    apart[0] = limit * random.between(1.2, 20.0)
    data = random.rubbing(
        random.unit_block(dim),
        {"displacements": [clamp(dim), {"on": "right", "value": apart}]},
        limit=limit,
        gap=random.pick([0.0, 0.1 * limit]),
    )
    return Case(data, Truth(admissible=False))


@family
def verge(random: Random) -> Case:
    """Prescribed displacements at a share of the largest that this mesh admits."""
    share = random.pick([0.9, 0.99, 0.999, 1.001, 1.01])
    dim, limit = random.pick([2, 2, 3]), random.pick([0.02, 1e-3])
    data = random.rubbing(
        random.unit_block(dim),
        {"displacements": [clamp(dim), {"on": "right", "value": random.vector(dim, limit)}]},
        limit=limit,
        gap=random.pick([0.0, 0.1 * limit]),
    )
    return Case(data, Truth(admissible=share < 1.0), verge=share)
