"""Studies that a first solver got wrong, each with what is known of its solution beforehand.

They are small, and found among random problems; names say what they show.
"""

from __future__ import annotations

import math

from case_parts import (
    CARRIED,
    HELD,
    block,
    cube,
    ends,
    inclusion,
    moved,
    pulled,
    rollers,
    smoothed,
    square,
    with_regions,
)
from sweep.case import Case, Truth, clamp, study

STIFF, STIFF_REGIONS = inclusion(0.15, 2e3)
RIGID, RIGID_REGIONS = inclusion(0.12, 3e6)
CONTRAST, CONTRAST_REGIONS = inclusion(0.12, 3e8, locking_limit=math.inf)

#: There is a solution, and everything that is told of it is right.
SOLVED: dict[str, Case] = {
    # Nothing to do, or next to nothing.
    "an approach without touch is a translation": Case(
        study(square(0.2), moved(0.0, -0.004), gap=0.03),
        Truth(admissible=True, touches=False, translation=(0.0, -0.004)),
    ),
    "without loads nothing happens": Case(
        study(square(0.2), {"displacements": [clamp(2, "top")]}, friction=0.5, limit=0.1),
        Truth(admissible=True, touches=False, translation=(0.0, 0.0)),
    ),
    "a body moved along a foundation that touches it exactly is not pressed": Case(
        study(square(0.2), moved(0.03, 0.0), limit=0.01, friction=0.5),
        Truth(admissible=True, translation=(0.03, 0.0)),
    ),
    "a body lowered by hardly more than its gap": Case(
        study(square(0.2), moved(0.0, -0.02002), gap=0.02), CARRIED
    ),
    "a tower that only grazes": Case(
        study(
            block(1.0, 12.0, h=0.6, structured=True),
            pulled(-5e-5, -4e-4),
            limit=0.001,
            friction=1.0,
            smoothing=smoothed("helmholtz", 1.0),
        ),
        HELD,
    ),
    "a slender beam, whose volume is much less than the cube of its length": Case(
        study(
            block(50.0, 1.0, 1.0, h=1.0, structured=True),
            pulled(5e-4, -2e-4, -1.2e-3),
            gap=0.1,
            friction=0.2,
            smoothing=smoothed("convolution", 4.0),
        ),
        HELD,
    ),
    # The foundation alone carries the load.
    "rollers over a gap, with friction": Case(
        study(square(0.2), rollers(0.001, "left"), limit=0.02, gap=0.2, friction=0.3),
        CARRIED,
    ),
    # u = 0 is admissible, so that nothing is infeasible.
    "rollers on both sides over a wide gap": Case(
        study(square(0.12), rollers(0.00406, "left", "right"), limit=0.0047, gap=1.0), HELD
    ),
    "a nearly incompressible tower with a small limit": Case(
        study(
            block(1.0, 5.0, h=0.3),
            pulled(2e-4, -3.2e-4),
            poisson=0.4999,
            limit=2e-4,
            gap=2e-4,
            friction=0.5,
            smoothing=smoothed("none"),
        ),
        HELD,
    ),
    "a nearly incompressible tower under a large load": Case(
        study(block(1.0, 5.0, h=0.3), pulled(0.04, -0.015), poisson=0.4999, limit=0.02, gap=0.002),
        HELD,
    ),
    "a stiff inclusion in a body with a small limit": Case(
        with_regions(study(STIFF, pulled(-0.002, -0.002), limit=0.001, gap=1e-4), STIFF_REGIONS),
        HELD,
    ),
    # Scales far apart.
    "epsilon much larger than what friction starts from": Case(
        with_regions(
            study(
                RIGID,
                pulled(0.03, -0.07),
                limit=0.06,
                friction=1.0,
                penalty={"n": 2e6, "epsilon": 0.03},
            ),
            RIGID_REGIONS,
        ),
        HELD,
    ),
    "epsilon in a soft unit of stress": Case(
        study(
            square(0.15),
            pulled(-2e-12, -1e-11),
            young=1e-9,
            limit=0.005,
            friction=0.2,
            smoothing=smoothed("helmholtz"),
            penalty={"n": 2e-5, "epsilon": 4e6},
        ),
        HELD,
    ),
    "a huge load on a body with a small limit": Case(
        study(square(0.2), pulled(0.0, -2e5), limit=2e-4), HELD
    ),
    "a coefficient of friction below zero by rounding": Case(
        study(
            cube(),
            pulled(-0.009, -0.025, -0.04),
            limit=0.03,
            friction="0.4*x",
            smoothing=smoothed("helmholtz"),
        ),
        HELD,
    ),
    "a filter two thousand bodies wide": Case(
        study(
            square(0.2),
            pulled(0.0, -0.03),
            friction=0.4,
            smoothing=smoothed("helmholtz", 2000.0),
        ),
        HELD,
    ),
    "an inclusion three hundred million times as stiff": Case(
        with_regions(
            study(CONTRAST, pulled(-0.012, -0.02), penalty={"n": 1e5, "epsilon": 2e-5}),
            CONTRAST_REGIONS,
        ),
        HELD,
    ),
    "a penalty so soft that the limit hardly counts": Case(
        study(
            cube(),
            pulled(-0.001, 0.0015, -0.0025),
            limit=0.003,
            gap=0.005,
            penalty={"n": 0.004, "epsilon": 1e-10},
        ),
        HELD,
    ),
    "a beam forty times as long as thick, whose bending enlarges what the forces leave": Case(
        study(
            block(40.0, 1.0, 1.0, h=1.0, structured=True),
            pulled(8.99715e-05, 7.96548e-05, -4.524975e-05),
            smoothing=smoothed("helmholtz", 4.0),
        ),
        HELD,
    ),
}

#: Nothing within limit and gap follows the prescribed displacements, by a thousandth.
INFEASIBLE: dict[str, Case] = {
    "a side pulled along and lowered a thousandth too far": Case(
        study(square(0.25), ends(-0.0196233, -0.0028033), limit=0.02), Truth(admissible=False)
    ),
    "a side pushed down a thousandth too far": Case(
        study(square(0.2), ends(0.00094153, -0.0094153), limit=0.02, gap=0.002),
        Truth(admissible=False),
    ),
}
