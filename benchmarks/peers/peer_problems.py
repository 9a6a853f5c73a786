"""The problems, their reference solutions by contact_locking at n = inf, and its two methods.

``hertz``: a cylinder on a plane (V6).  ``block``: a block pressed and dragged with Coulomb friction
of the local pressure.  ``locking``: the same block with a strain limit.  ``smooth``: that one
without friction.  ``plate``: SSNV128.  ``stack``: a block on another
one, whose mesh does not match.  ``punch``: a punch with a fillet on a foundation, the outline of
the NAFEMS contact benchmark 2 in plane strain.  ``roller`` and ``roller_friction``: the NAFEMS
contact benchmark 1.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import fem
from exchange import Problem

from contact_locking import Parameters, StudySolution

sys.path.append(str(Path(__file__).parents[2] / "tests" / "support"))
from benchmark_bodies import punch_with_fillet, roller

# Lengths are in units of the body's, stresses in units of Young's modulus, as the tests of
# convergence of some programs add forces and displacements.
STUDIES: dict[str, dict[str, Any]] = {
    # R = 8, E = 200, F = 10 per length.
    "hertz": {
        "mesh": {
            "builder": "disc",
            "quarter": True,
            "radius": 1.0,
            "h": 0.1,
            "h_contact": 0.03 / 8.0,
            "contact_width": 1.2 / 8.0,
        },
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": {
            "tractions": [{"on": "top", "value": [0.0, -0.625 / 200.0]}],
            "displacements": [{"on": "symmetry", "value": [0.0, None]}],
        },
        "contact": {
            "on": "contact",
            "foundation": {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        },
    },
    "block": {
        "mesh": {"builder": "block", "h": 1.0 / 32.0, "structured": True},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": {
            "tractions": [{"on": "top", "value": [0.03, -0.05]}],
            "displacements": [{"on": "left", "value": [0.0, 0.0]}],
        },
        "contact": {"on": "bottom"},
        "friction": {"coefficient": 0.3, "smoothing": {"kernel": "none"}},
    },
    # 40 mm, E = 1.3e11 Pa, 5e7 and 15e7 Pa: 32 x 32 squares, cut into triangles.
    "plate": {
        "mesh": {"builder": "block", "h": 1.0 / 32.0, "structured": True},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.2}},
        "loads": {
            "tractions": [
                {"on": "top", "value": [0.0, -5e7 / 1.3e11]},
                {"on": "left", "value": [15e7 / 1.3e11, 0.0]},
            ],
            "displacements": [{"on": "right", "value": [0.0, None]}],
        },
        "contact": {"on": "bottom"},
        "friction": {"coefficient": 1.0, "smoothing": {"kernel": "none"}},
    },
}
STUDIES["stack"] = {
    "mesh": {"builder": "stack", "h": 1.0 / 32.0},
    "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
    "loads": {
        "tractions": [{"on": "top", "value": [0.03, -0.05]}],
        "displacements": [
            {"on": "bottom", "value": [0.0, 0.0]},
            {"on": "upper_left", "value": [0.0, 0.0]},
        ],
    },
    "contact": {"on": "upper_bottom", "against": "lower_top", "pair": "once"},
    "friction": {"coefficient": 0.3, "smoothing": {"kernel": "none"}},
}
STUDIES["locking"] = STUDIES["block"] | {
    "material": STUDIES["block"]["material"] | {"locking_limit": 0.02}
}


def benchmark(
    file: str, body: str, held: str, part: str, load: float, sole: str, mu: float
) -> dict[str, Any]:
    """A body that is three times as stiff as the foundation, of lengths in mm."""
    return {
        "mesh": {"file": file},
        "material": {
            "elasticity": {"young": 1.0, "poisson": 0.3},
            "regions": {body: {"elasticity": {"young": 3.0, "poisson": 0.3}}},
        },
        "loads": {
            "tractions": [{"on": part, "value": [0.0, -load / 70e3]}],
            "displacements": [
                {"on": "base", "value": [0.0, 0.0]},
                {"on": held, "value": [0.0, None]},
            ],
        },
        "contact": {"on": sole, "against": "face"},
        "friction": {"coefficient": mu, "smoothing": {"kernel": "none"}},
    }


# A half of the force 35 000 on the crown, an arc of radius 50 and of the width 2.
CROWN = 17500.0 / (50.0 * math.asin(2.0 / 50.0))
STUDIES["punch"] = benchmark("punch.msh", "punch", "axis", "top", 100.0, "sole", 0.0)
STUDIES["roller"] = benchmark("roller.msh", "roll", "middle", "crown", CROWN, "arc", 0.0)
STUDIES["roller_friction"] = STUDIES["roller"] | {
    "friction": {"coefficient": 0.1, "smoothing": {"kernel": "none"}}
}
# The fine cells of the two meshes in mm.
MESHES = {
    "punch.msh": lambda folder: punch_with_fillet(folder, 0.8, 0.15),
    "roller.msh": lambda folder: roller(folder, 0.2),
}
# Where the displacement in y is compared: below the middle of the punch, and at the crown.
PROBES = {"punch": (0.0, 0.0), "roller": (0.0, 100.0), "roller_friction": (0.0, 100.0)}
STUDIES["smooth"] = STUDIES["locking"] | {"friction": {"coefficient": 0.0}}


def problem(name: str, solution: StudySolution) -> Problem:
    """A problem on the mesh of a solution, with the friction bound of the solution."""
    given, domain = STUDIES[name], solution.domain
    x, cells = displaced(solution)[0], solution.displacement.function_space.dofmap.list
    space = solution.displacement.function_space
    parts = {}
    for part in domain.facet_names:
        facets = domain.facets((part,))
        nodes = [fem.locate_dofs_topological(space, 1, np.array([facet])) for facet in facets]
        parts[part] = np.array(nodes)
    held = given["loads"]["displacements"]
    # A benchmark's region is the body that has the contact conditions.
    soft = given["material"]["elasticity"]["young"]
    regions = list(given["material"].get("regions", {}).values())
    return Problem(
        x=x,
        cells=cells,
        parts=parts,
        young=regions[0]["elasticity"]["young"] if regions else soft,
        poisson=given["material"]["elasticity"]["poisson"],
        limit=given["material"].get("locking_limit", math.inf),
        friction=given.get("friction", {}).get("coefficient", 0.0),
        contact=given["contact"]["on"],
        against=given["contact"].get("against"),
        young_against=soft,
        tractions={item["on"]: item["value"] for item in given["loads"]["tractions"]},
        held={
            item["on"]: [j for j, value in enumerate(item["value"]) if value is not None]
            for item in held
        },
        study=given,
        bound=solution.friction_bound.x.array,
    )


def displaced(solution: StudySolution) -> tuple[Any, Any]:
    """The nodes and their displacements, both (k, 2)."""
    space = solution.displacement.function_space
    return space.tabulate_dof_coordinates()[:, :2], solution.displacement.x.array.reshape(-1, 2)


def write(name: str, folder: Path) -> StudySolution:
    """Solve a problem at n = inf and write it for the peers."""
    from contact_locking import solve

    mesh = STUDIES[name]["mesh"]
    if mesh.get("file") in MESHES:
        mesh["file"] = str(MESHES[mesh["file"]](folder))
    solution = solve(Parameters.model_validate(STUDIES[name]))
    assert solution.converged, solution.summary["reason"]
    problem(name, solution).save(folder / f"{name}.npz")
    np.save(folder / f"{name}-reference.npy", displaced(solution)[1])
    return solution
