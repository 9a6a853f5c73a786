"""Studies that a first solver got wrong, each with what is known of its solution beforehand.

They are small, and found among random problems; names say what they show.
"""

from __future__ import annotations

import math
from typing import Any

from sweep.case import Case, Study, Truth, clamp, study


def _block(*size: float, h: float, structured: bool = False) -> Study:
    return {
        "builder": "block",
        "dim": len(size),
        "size": list(size),
        "h": h,
        "structured": structured,
    }


def _square(h: float = 0.25) -> Study:
    return _block(1.0, 1.0, h=h)


def _cube(h: float = 0.35) -> Study:
    return _block(1.0, 1.0, 1.0, h=h)


def _inclusion(h: float, young: float, **more: Any) -> tuple[Study, Study]:
    """A mesh, and the regions of its material."""
    regions = {"inclusion": {"elasticity": {"young": young, "poisson": 0.3}, **more}}
    return {"builder": "inclusion", "dim": 2, "h": h}, regions


def _pulled(*traction: float, on: str = "top", **more: Any) -> Study:
    """Clamped on the left and loaded by a traction."""
    return {
        "tractions": [{"on": on, "value": list(traction)}],
        "displacements": [clamp(len(traction))],
        **more,
    }


def _moved(*value: float, on: str = "top") -> Study:
    return {"displacements": [{"on": on, "value": list(value)}]}


def _ends(*value: float) -> Study:
    """Clamped on the left, the right side moved."""
    return {"displacements": [clamp(len(value)), {"on": "right", "value": list(value)}]}


def _smoothed(kernel: str, radius: float = 0.3) -> Study:
    return {"kernel": kernel, "radius": radius}


def _rollers(pressure: float, *sides: str) -> Study:
    return {
        "displacements": [{"on": list(sides), "value": [0.0, None]}],
        "tractions": [{"on": "top", "value": [0.0, -pressure]}],
    }


def _with_regions(data: Study, regions: Study) -> Study:
    data["material"]["regions"] = regions
    return data


_HELD = Truth(admissible=True)
_CARRIED = Truth(admissible=True, touches=True)

STIFF, STIFF_REGIONS = _inclusion(0.15, 2e3)
RIGID, RIGID_REGIONS = _inclusion(0.12, 3e6)
CONTRAST, CONTRAST_REGIONS = _inclusion(0.12, 3e8, locking_limit=math.inf)

#: There is a solution, and everything that is told of it is right.
SOLVED: dict[str, Case] = {
    # Nothing to do, or next to nothing.
    "an approach without touch is a translation": Case(
        study(_square(0.2), _moved(0.0, -0.004), gap=0.03),
        Truth(admissible=True, touches=False, translation=(0.0, -0.004)),
    ),
    "without loads nothing happens": Case(
        study(_square(0.2), {"displacements": [clamp(2, "top")]}, friction=0.5, limit=0.1),
        Truth(admissible=True, touches=False, translation=(0.0, 0.0)),
    ),
    "a body moved along a foundation that touches it exactly is not pressed": Case(
        study(_square(0.2), _moved(0.03, 0.0), limit=0.01, friction=0.5),
        Truth(admissible=True, translation=(0.03, 0.0)),
    ),
    "a body lowered by hardly more than its gap": Case(
        study(_square(0.2), _moved(0.0, -0.02002), gap=0.02), _CARRIED
    ),
    "a tower that only grazes": Case(
        study(
            _block(1.0, 12.0, h=0.6, structured=True),
            _pulled(-5e-5, -4e-4),
            limit=0.001,
            friction=1.0,
            smoothing=_smoothed("helmholtz", 1.0),
        ),
        _HELD,
    ),
    "a slender beam, whose volume is much less than the cube of its length": Case(
        study(
            _block(50.0, 1.0, 1.0, h=1.0, structured=True),
            _pulled(5e-4, -2e-4, -1.2e-3),
            gap=0.1,
            friction=0.2,
            smoothing=_smoothed("convolution", 4.0),
        ),
        _HELD,
    ),
    # The foundation alone carries the load.
    "rollers over a gap, with friction": Case(
        study(_square(0.2), _rollers(0.001, "left"), limit=0.02, gap=0.2, friction=0.3),
        _CARRIED,
    ),
    # u = 0 is admissible, so that nothing is infeasible.
    "rollers on both sides over a wide gap": Case(
        study(_square(0.12), _rollers(0.00406, "left", "right"), limit=0.0047, gap=1.0), _HELD
    ),
    "a nearly incompressible tower with a small limit": Case(
        study(
            _block(1.0, 5.0, h=0.3),
            _pulled(2e-4, -3.2e-4),
            poisson=0.4999,
            limit=2e-4,
            gap=2e-4,
            friction=0.5,
            smoothing=_smoothed("none"),
        ),
        _HELD,
    ),
    "a nearly incompressible tower under a large load": Case(
        study(
            _block(1.0, 5.0, h=0.3), _pulled(0.04, -0.015), poisson=0.4999, limit=0.02, gap=0.002
        ),
        _HELD,
    ),
    "a stiff inclusion in a body with a small limit": Case(
        _with_regions(study(STIFF, _pulled(-0.002, -0.002), limit=0.001, gap=1e-4), STIFF_REGIONS),
        _HELD,
    ),
    # Friction bounds that do not settle by being updated.
    "full slip at large friction": Case(
        study(
            _block(2.0, 0.5, h=0.125, structured=True),
            _moved(0.25, -0.012),
            poisson=0.1,
            friction=4.0,
            smoothing=_smoothed("convolution", 0.2),
        ),
        _CARRIED,
    ),
    "local friction in space": Case(
        study(
            _cube(0.22),
            _pulled(-0.0005, -0.002, -0.0066, body_force=[-0.0068, -0.0081, -0.0145]),
            limit=0.0048,
            gap=0.002,
            friction=0.7,
            smoothing=_smoothed("none"),
        ),
        _HELD,
    ),
    "a layer with a tiny limit at the clamp": Case(
        study(
            _cube(0.3),
            _pulled(-0.016, 0.009, -0.04),
            limit="1e-6 if x < 0.25 else 0.05",
            friction=0.2,
            smoothing=_smoothed("none"),
        ),
        _HELD,
    ),
    "local friction under an L": Case(
        study(
            {"builder": "l_shape", "dim": 2, "h": 0.1},
            {
                "tractions": [{"on": "inner_horizontal", "value": [0.012, 0.016]}],
                "displacements": [{"on": "top", "value": [0.0, -0.0055]}],
            },
            poisson=0.1,
            limit=0.019,
            gap=0.002,
            friction=0.9,
            smoothing=_smoothed("none"),
        ),
        Truth(),
    ),
    "friction that falls within a small slip": Case(
        study(_square(0.15), _pulled(0.006, -0.0179), friction="0.22 - 0.17*s/(s + 0.0002)"),
        _HELD,
    ),
    "a cylinder that reaches into a cube": Case(
        study(
            _cube(),
            _moved(-0.02, 0.003, -0.025),
            limit=0.02,
            gap={"cylinder": {"centre": [0.5, 0.5, -0.61], "radius": 0.6}},
            friction=0.5,
            smoothing=_smoothed("none"),
        ),
        Truth(),
    ),
    "friction at 99 % of what the limit admits": Case(
        study(
            _square(0.2),
            _ends(0.009311868704427824, -0.009311868704427824),
            limit=0.02,
            gap=0.002,
            friction=0.3,
        ),
        _HELD,
    ),
    # Friction that only one of several starts finds.
    "friction that falls steeply with the slip": Case(
        study(
            _block(1.0, 1.0, h=0.2, structured=True),
            _pulled(0.0336245, -0.064959333),
            limit=0.04905,
            gap=0.004905,
            friction="0.3 - 0.25*s/(s + 0.0003437)",
            smoothing=_smoothed("helmholtz"),
        ),
        _HELD,
    ),
    "local friction in a locked cube": Case(
        study(
            _cube(0.4),
            _pulled(1.70234, -0.659051, -10.2197734),
            limit=0.0001946,
            friction=0.2,
            smoothing=_smoothed("none"),
        ),
        _HELD,
    ),
    # Scales far apart.
    "epsilon much larger than what friction starts from": Case(
        _with_regions(
            study(
                RIGID,
                _pulled(0.03, -0.07),
                limit=0.06,
                friction=1.0,
                penalty={"n": 2e6, "epsilon": 0.03},
            ),
            RIGID_REGIONS,
        ),
        _HELD,
    ),
    "epsilon in a soft unit of stress": Case(
        study(
            _square(0.15),
            _pulled(-2e-12, -1e-11),
            young=1e-9,
            limit=0.005,
            friction=0.2,
            smoothing=_smoothed("helmholtz"),
            penalty={"n": 2e-5, "epsilon": 4e6},
        ),
        _HELD,
    ),
    "a huge load on a body with a small limit": Case(
        study(_square(0.2), _pulled(0.0, -2e5), limit=2e-4), _HELD
    ),
    "a coefficient of friction below zero by rounding": Case(
        study(
            _cube(),
            _pulled(-0.009, -0.025, -0.04),
            limit=0.03,
            friction="0.4*x",
            smoothing=_smoothed("helmholtz"),
        ),
        _HELD,
    ),
    "a filter two thousand bodies wide": Case(
        study(
            _square(0.2),
            _pulled(0.0, -0.03),
            friction=0.4,
            smoothing=_smoothed("helmholtz", 2000.0),
        ),
        _HELD,
    ),
    "an inclusion three hundred million times as stiff": Case(
        _with_regions(
            study(CONTRAST, _pulled(-0.012, -0.02), penalty={"n": 1e5, "epsilon": 2e-5}),
            CONTRAST_REGIONS,
        ),
        _HELD,
    ),
    "a penalty so soft that the limit hardly counts": Case(
        study(
            _cube(),
            _pulled(-0.001, 0.0015, -0.0025),
            limit=0.003,
            gap=0.005,
            penalty={"n": 0.004, "epsilon": 1e-10},
        ),
        _HELD,
    ),
    "a beam forty times as long as thick, whose bending enlarges what the forces leave": Case(
        study(
            _block(40.0, 1.0, 1.0, h=1.0, structured=True),
            _pulled(8.99715e-05, 7.96548e-05, -4.524975e-05),
            smoothing=_smoothed("helmholtz", 4.0),
        ),
        _HELD,
    ),
}

#: Nothing within limit and gap follows the prescribed displacements, by a thousandth.
INFEASIBLE: dict[str, Case] = {
    "a side pulled along and lowered a thousandth too far": Case(
        study(_square(0.25), _ends(-0.0196233, -0.0028033), limit=0.02), Truth(admissible=False)
    ),
    "a side pushed down a thousandth too far": Case(
        study(_square(0.2), _ends(0.00094153, -0.0094153), limit=0.02, gap=0.002),
        Truth(admissible=False),
    ),
}

# Studies whose penalised solutions have forces in proportion to the penalty.
WEDGED: dict[str, Case] = {
    "friction wedges a locked block between its sides and the foundation": Case(
        study(
            _block(1.0, 1.0, h=0.25, structured=True),
            {"displacements": [clamp(2), {"on": "right", "value": [0.00773175, -0.01114484]}]},
            limit=0.02,
            gap=0.002,
            friction=0.8,
            smoothing={"kernel": "none"},
        ),
        Truth(admissible=True),
    ),
}
