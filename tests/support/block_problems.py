"""Problems on a unit block, each a function of the dimension, for comparisons of results.

The mesh is left out; sides and cells have the names of `answers.Block`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from sweep.case import Study, clamp, study

Make = Callable[[int], Study]

# Wider than the facets, so that R smooths.
_SMOOTHING = {"kernel": "convolution", "radius": 0.6}


def _vector(dim: int, along: float, down: float) -> list[Any]:
    return [along, *[0.3 * along] * (dim - 2), -down]


def _pulled(dim: int, along: float = 0.03, down: float = 0.05) -> Study:
    return {
        "tractions": [{"on": "top", "value": _vector(dim, along, down)}],
        "displacements": [clamp(dim)],
    }


def _gently_pulled(dim: int) -> Study:
    """Strains stay below a tenth, above which a warning says that they are not small."""
    return _pulled(dim, 0.015, 0.025)


def _point(dim: int, height: float) -> list[float]:
    return [*[0.5] * (dim - 1), height]


def locking(dim: int) -> Study:
    """The inequality itself, with a body force and a gap that opens."""
    loads = _pulled(dim) | {"body_force": _vector(dim, 0.01, 0.03)}
    gap = "0.001 + 0.01*(1 - x)"
    return study({}, loads, limit=0.02, gap=gap, friction=0.3, smoothing=_SMOOTHING)


def penalised(dim: int) -> Study:
    """n and epsilon are given; the regularisation of friction follows from epsilon."""
    kernel = {"kernel": "helmholtz", "radius": 0.6}
    penalty = {"n": 1e3, "epsilon": 1e-3}
    return study({}, _pulled(dim), limit=0.02, friction=0.1, smoothing=kernel, penalty=penalty)


def regularised(dim: int) -> Study:
    """The regularisation is a length; rollers leave components free."""
    left = {"on": "left", "value": [0.0, *[None] * (dim - 1)]}
    top = {"on": "top", "value": [None] * (dim - 1) + [-0.02]}
    loads = {"displacements": [left, top]}
    if dim == 3:
        loads["displacements"].append({"on": "front", "value": [None, 0.0, None]})
    penalty = {"n": 1e3, "epsilon": 1e-4}
    gap = "0.01*x"
    data = study(
        {}, loads, limit=0.02, gap=gap, friction=0.3, smoothing=_SMOOTHING, penalty=penalty
    )
    data["friction"]["regularisation"] = 1e-3
    return data


def half_space(dim: int) -> Study:
    """An elastic body moves onto a tilted plane, with local Coulomb friction."""
    plane = {"half_space": {"point": _point(dim, -0.01), "normal": [0.02, *[0.0] * (dim - 2), 1.0]}}
    loads = {"displacements": [{"on": "top", "value": _vector(dim, 0.01, 0.03)}]}
    return study({}, loads, gap=plane, friction=0.3, smoothing={"kernel": "none"})


def sphere(dim: int) -> Study:
    """A body moves onto a sphere, and the friction coefficient falls with the slip."""
    body = {"sphere": {"centre": _point(dim, -2.005), "radius": 2.0}}
    loads = {
        "displacements": [{"on": "top", "value": _vector(dim, 0.02, 0.02 if dim == 2 else 0.03)}]
    }
    return study(
        {}, loads, limit=0.02, gap=body, friction="0.2 + 0.2*exp(-s/0.02)", smoothing=_SMOOTHING
    )


def regions(dim: int) -> Study:
    """An anisotropic tensor, a stiffer half with a limit of its own, limits and mu vary."""
    size = dim * (dim + 1) // 2
    tensor = np.diag(np.linspace(1.0, 2.0, size)) + 0.1 * np.ones((size, size))
    data = study(
        {}, _pulled(dim), limit="0.02 + 0.02*x", friction="0.2 + 0.2*x", smoothing=_SMOOTHING
    )
    data["material"]["regions"] = {"stiff": {"elasticity": {"stiffness": tensor.tolist()}}}
    return data


def proportional(dim: int) -> Study:
    """No limit, no gap, a constant mu: the displacement is proportional to the loads."""
    loads = _gently_pulled(dim) | {"body_force": _vector(dim, 0.005, 0.015)}
    return study({}, loads, friction=0.3, smoothing=_SMOOTHING)


def proportional_local(dim: int) -> Study:
    kernel = {"kernel": "none"}
    return study({}, _gently_pulled(dim), friction=0.3, smoothing=kernel)


def proportional_penalised(dim: int) -> Study:
    """Without friction, and without locking, so that n has no influence."""
    return study({}, _gently_pulled(dim), penalty={"n": 1e3, "epsilon": 1e-2})


def proportional_rubbing(dim: int) -> Study:
    """A penalised contact with Coulomb's law itself, which has no length."""
    penalty = {"n": 1e3, "epsilon": 1e-2}
    data = study({}, _gently_pulled(dim), friction=0.3, smoothing=_SMOOTHING, penalty=penalty)
    data["friction"]["regularisation"] = 0.0
    return data


def at_rest(dim: int) -> Study:
    return study({}, {"displacements": [clamp(dim)]}, limit=0.02, friction=0.3)


def without_load(dim: int) -> Study:
    return study({}, _pulled(dim, 0.0, 0.0), limit=0.02, gap=0.01, friction=0.3)


def approach(dim: int) -> Study:
    return _moved(dim, _vector(dim, 0.003, 0.008), gap=0.01)


def approach_to_a_sphere(dim: int) -> Study:
    body = {"sphere": {"centre": _point(dim, -2.01), "radius": 2.0}}
    return _moved(dim, _vector(dim, 0.0, 0.005), gap=body)


def rigid_motion(dim: int) -> Study:
    return _moved(dim, _vector(dim, 0.3, 0.0))


def rigid_rotation(dim: int) -> Study:
    up = "y" if dim == 2 else "z"
    return _moved(dim, [f"0.001*({up} - 1)", *[0.0] * (dim - 2), "-0.001*x"], gap=0.01)


def exact_touch(dim: int) -> Study:
    return _moved(dim, _vector(dim, 0.0, 0.01), gap=0.01)


def exact_touch_of_a_plane(dim: int) -> Study:
    plane = {"half_space": {"point": _point(dim, -0.01), "normal": _vector(dim, 0.0, -1.0)}}
    return _moved(dim, _vector(dim, 0.0, 0.01), gap=plane)


def _moved(dim: int, value: list[Any], **more: Any) -> Study:
    """The top has a prescribed displacement."""
    loads = {"displacements": [{"on": "top", "value": value}]}
    return study({}, loads, limit=0.02, friction=0.3, **more)


def corner(dim: int = 2) -> Study:
    """Contact on two sides, with the default radius of R."""
    data = study({}, _pulled(dim), on=["bottom", "right"], friction=0.3)
    data["friction"]["smoothing"] = {"kernel": "convolution"}
    return data


def pressed_builder(dim: int) -> Study:
    """Steel in pascals and metres, on a mesh of a builder, with the default penalties."""
    mesh = {"builder": "block", "dim": dim, "size": [0.2] + [0.1] * (dim - 1), "h": 0.05}
    loads = _pulled(dim, 3e7, 1e8)
    smoothing = {"kernel": "convolution", "radius": 0.08}
    gap = "1e-5 + 1e-3*x"
    data = study(mesh, loads, young=2.1e11, limit=1e-3, gap=gap, friction=0.3, smoothing=smoothing)
    del data["material"]["elasticity"]["poisson"]
    return data | {"penalty": {}}


TURNABLE: list[Make] = [locking, penalised, half_space, sphere, regions]
# With rollers, which have a direction of the axes.
ALL: list[Make] = [*TURNABLE, regularised]
PROPORTIONAL: list[Make] = [
    proportional,
    proportional_local,
    proportional_penalised,
    proportional_rubbing,
]
IDLE = [
    at_rest,
    without_load,
    approach,
    approach_to_a_sphere,
    rigid_motion,
    rigid_rotation,
    exact_touch,
    exact_touch_of_a_plane,
]
