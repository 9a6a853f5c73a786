"""Studies of friction that a first solver got wrong, each with what is known of its solution.

They are small, and found among random problems; names say what they show.
"""

from __future__ import annotations

from case_parts import CARRIED, HELD, block, cube, ends, moved, pulled, smoothed, square
from sweep.case import Case, Truth, clamp, study

#: There is a solution, and everything that is told of it is right.
SOLVED: dict[str, Case] = {
    "a strip on a floor that friction alone holds along it, lifted at one end": Case(
        study(
            block(30.0, 1.0, h=1.0, structured=True),
            {
                "body_force": [0.0, -1e-7],
                "displacements": [{"on": "right", "value": [None, 2.5e-3]}],
            },
            friction=0.2,
            smoothing=smoothed("none"),
        ),
        CARRIED,
    ),
    "a block in space that slides until friction that grows with the slip holds it": Case(
        study(
            block(1.0, 1.0, 1.0, h=0.5, structured=True),
            {
                "tractions": [
                    {"on": "top", "value": [0.0, 0.0, -2.265e-5]},
                    {"on": "bottom", "value": [-8.2718709e-06, 1.20960554e-05, 0.0]},
                ]
            },
            poisson=0.0,
            friction="0.4764 + 0.28818*(1 - exp(-s/4.129e-06))",
            smoothing=smoothed("helmholtz", 0.6),
        ),
        Truth(admissible=True, touches=True, slip=(-2.0889092e-06, 3.0546368e-06)),
    ),
    "a coefficient of ten thousand under a block that sticks": Case(
        study(
            block(2.0, 1.0, h=0.2),
            moved(0.0, -0.02),
            poisson=0.49,
            friction=1e4,
            smoothing=smoothed("none"),
        ),
        CARRIED,
    ),
    # Friction bounds that do not settle by being updated.
    "full slip at large friction": Case(
        study(
            block(2.0, 0.5, h=0.125, structured=True),
            moved(0.25, -0.012),
            poisson=0.1,
            friction=4.0,
            smoothing=smoothed("convolution", 0.2),
        ),
        CARRIED,
    ),
    "a coefficient of eight under a block that is dragged": Case(
        study(
            block(2.0, 0.5, h=0.125, structured=True),
            moved(0.2, -0.01),
            poisson=0.0,
            friction=8.0,
            smoothing=smoothed("convolution", 0.2),
        ),
        CARRIED,
    ),
    "local friction in space": Case(
        study(
            cube(0.22),
            pulled(-0.0005, -0.002, -0.0066, body_force=[-0.0068, -0.0081, -0.0145]),
            limit=0.0048,
            gap=0.002,
            friction=0.7,
            smoothing=smoothed("none"),
        ),
        HELD,
    ),
    "a layer with a tiny limit at the clamp": Case(
        study(
            cube(0.3),
            pulled(-0.016, 0.009, -0.04),
            limit="1e-6 if x < 0.25 else 0.05",
            friction=0.2,
            smoothing=smoothed("none"),
        ),
        HELD,
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
            smoothing=smoothed("none"),
        ),
        Truth(),
    ),
    "friction that falls within a small slip": Case(
        study(square(0.15), pulled(0.006, -0.0179), friction="0.22 - 0.17*s/(s + 0.0002)"),
        HELD,
    ),
    "a cylinder that reaches into a cube": Case(
        study(
            cube(),
            moved(-0.02, 0.003, -0.025),
            limit=0.02,
            gap={"cylinder": {"centre": [0.5, 0.5, -0.61], "radius": 0.6}},
            friction=0.5,
            smoothing=smoothed("none"),
        ),
        Truth(),
    ),
    "friction at 99 % of what the limit admits": Case(
        study(
            square(0.2),
            ends(0.009311868704427824, -0.009311868704427824),
            limit=0.02,
            gap=0.002,
            friction=0.3,
        ),
        HELD,
    ),
    # Friction that only one of several starts finds.
    "friction that falls steeply with the slip": Case(
        study(
            block(1.0, 1.0, h=0.2, structured=True),
            pulled(0.0336245, -0.064959333),
            limit=0.04905,
            gap=0.004905,
            friction="0.3 - 0.25*s/(s + 0.0003437)",
            smoothing=smoothed("helmholtz"),
        ),
        HELD,
    ),
    "local friction in a locked cube": Case(
        study(
            cube(0.4),
            pulled(1.70234, -0.659051, -10.2197734),
            limit=0.0001946,
            friction=0.2,
            smoothing=smoothed("none"),
        )
        # With 1e-8 the problem in other units may differ by 1e-14 of the energy, its limit.
        | {"solver": {"tolerance": 1e-10, "friction_tolerance": 1e-10}},
        HELD,
    ),
}

# Studies whose penalised solutions have forces in proportion to the penalty.
WEDGED: dict[str, Case] = {
    "friction wedges a locked block between its sides and the foundation": Case(
        study(
            block(1.0, 1.0, h=0.25, structured=True),
            {"displacements": [clamp(2), {"on": "right", "value": [0.00773175, -0.01114484]}]},
            limit=0.02,
            gap=0.002,
            friction=0.8,
            smoothing={"kernel": "none"},
        ),
        Truth(admissible=True),
    ),
}
