"""The family of bodies of curved cells, which are pressed on foundations."""

from __future__ import annotations

from .case import Case, Random, Study, between, chance, decades, family, pick, vector
from .free import Scale


@family
def curved_cells(random: Random) -> Case:
    """A ring, a disc, a body of revolution or a ball, with friction and sometimes a limit."""
    kind = pick(random, ["ring", "ring", "disc", "disc", "half section", "ball", "half ball"])
    scale = Scale.draw(random, 3 if "ball" in kind else 2)
    mesh, loads, contact = (_ring if kind == "ring" else _round)(scale, kind)
    mesh["curved"] = True
    study = scale.study(mesh, loads, contact, pick(random, [0.0, 0.2, 0.5]))
    study["discretisation"] = {"degree": 2, "limit_at": "gauss"}
    return Case(study, own_judge=True)


def _rollers(dim: int, planes: dict[str, int]) -> list[Study]:
    return [
        {"on": name, "value": [0.0 if i == axis else None for i in range(dim)]}
        for name, axis in planes.items()
    ]


def _ring(scale: Scale, kind: str) -> tuple[Study, Study, Study]:
    """A quarter of a ring on a shaft or in a ring, or a whole one in a groove that is wider."""
    random, (inner, outer, h) = scale.random, scale.at(0.5, 1.0, 0.3)
    mesh: Study = {"builder": "annulus", "inner_radius": inner, "outer_radius": outer, "h": h}
    stress, way = scale.strain * scale.young, scale.depth * scale.length
    loads: Study = {}
    if chance(random, 0.7):
        mesh["quarter"] = True
        loads["displacements"] = _rollers(2, {"bottom": 1, "left": 0})
        on, other = pick(random, [("inner", "outer"), ("outer", "inner")])
        tool: Study = {"sphere": {"centre": [0.0, 0.0], "radius": inner + 0.5 * way}}
        if on == "outer":
            tool = {"expression": f"{outer - 0.5 * way:.12g} - sqrt(x**2 + y**2)"}
        push = pick(random, [0.0, 0.2, 0.5]) * stress
        loads["pressures"] = [{"on": other, "value": scale.over_time(push)[0]}]
        return mesh, loads, {"on": on, "foundation": tool}
    loads["displacements"] = [{"on": "inner", "value": scale.over_time(0.3 * way, -way)}]
    # The centre of the groove is no node.  A part of the ring sees a wide groove from behind.
    groove = pick(random, [between(random, 1.1, 1.7), between(random, 2.3, 4.0)]) * scale.length
    up = f"{groove - outer:.12g}"
    tool = {"expression": f"{groove:.12g} - sqrt(x**2 + (y - {up})**2)"}
    return mesh, loads, {"on": "outer", "foundation": tool}


def _round(scale: Scale, kind: str) -> tuple[Study, Study, Study]:
    """The lower half of a disc or a ball, or a quarter, pressed down or by its foundation."""
    random, dim = scale.random, scale.dim
    around, quarter = kind == "half section", kind in ("half section", "ball")
    mesh: Study = {"builder": "ball" if dim == 3 else "disc", "radius": scale.at(1.0)[0]}
    width, h = scale.at(0.6, 0.6 if dim == 3 else 0.3)
    mesh |= {"contact_width": width, "h": h, "quarter": quarter}
    way, stress = scale.depth * scale.length, scale.strain * scale.young
    down = scale.over_time(*[0.0] * (dim - 1), -pick(random, [0.0, 1.0]) * way)
    if quarter:
        planes = {"symmetry_x": 0, "symmetry_y": 1} if dim == 3 else {}
        loads: Study = {"displacements": _rollers(dim, planes)}
        top = [*[None] * (dim - 1), down[-1]]
        loads["displacements"].append({"on": "top", "value": top})
    else:
        mesh["quarter"] = False
        loads = {"displacements": [{"on": "top", "value": down}]}
    if around:
        mesh["axisymmetric"] = True
    pull = pick(random, [0.0, 0.1]) * stress
    loads["pressures"] = [{"on": "side", "value": scale.over_time(pull)[0]}]
    lean = [0.0] * (dim - 1) if quarter else vector(random, dim - 1, scale.depth)
    room = pick(random, [0.0, -0.5, 0.5]) * scale.depth
    low = scale.at(*[0.0] * (dim - 1), -room)
    tool: Study = {"half_space": {"point": low, "normal": [*lean, 1.0]}}
    if chance(random, 0.4):
        radius = between(random, 1.0, 4.0)
        ball = scale.at(*[0.0] * (dim - 1), -room - radius)
        tool = {"sphere": {"centre": ball, "radius": scale.at(radius)[0]}}
    pushed = pick(random, ["no", "force", "spring"])
    size = scale.force * between(random, 0.02, 0.1)
    if pushed == "force":
        tool["force"] = scale.over_time(*[0.0] * (dim - 1), size)
    elif pushed == "spring":
        stiffness = decades(random, -1.0, 2.0) * scale.young * scale.length ** (dim - 2 + around)
        tool["spring"] = {"stiffness": stiffness, "along": [0.0] * (dim - 1) + [1.0]}
        tool["motion"] = scale.over_time(*[0.0] * (dim - 1), way)
    return mesh, loads, {"on": "contact", "foundation": tool}
