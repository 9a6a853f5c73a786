"""Two bodies of published contact benchmarks: meshes that do not match, and their studies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from outlines import Outlines, Side, Size, graded, write_outlines

from contact_locking import StudySolution, solve
from contact_locking.study_file import from_mapping

# The radius of the cylinders, and their compression under the force 10.
RADIUS, COMPRESSION = 8.0, 0.182773


def solved(study: dict[str, Any], **changes: Any) -> StudySolution:
    """The solution of a study without pictures and fields, with other sections."""
    output = {"fields": False, "picture": False} | study.get("output", {})
    solution = solve(from_mapping(study | {"output": output} | changes))
    assert solution.converged, solution.summary["reason"]
    return solution


def moved(solution: StudySolution) -> float:
    """The vertical displacement of the first probe."""
    assert solution.probes is not None
    return float(solution.probes.last("u_y"))


def steel_on_aluminium(path: Path, steel: str, **sections: Any) -> dict[str, Any]:
    return {
        "mesh": {"file": str(path)},
        "material": {
            "elasticity": {"young": 70000.0, "poisson": 0.3},
            "regions": {steel: {"elasticity": {"young": 210000.0, "poisson": 0.3}}},
        },
    } | sections


def friction(coefficient: float) -> dict[str, Any]:
    return {"coefficient": coefficient, "smoothing": {"kernel": "none"}}


def punch_with_fillet(folder: Path, size: float, edge: float) -> Path:
    """NAFEMS benchmark 2: a punch of the flat radius 40 and a fillet of 10, on a foundation.

    Cells have the ``size`` below the punch and the size ``edge`` at the end of its flat part.
    """
    punch = [
        Side("sole flat", (0.0, 0.0)),
        Side("sole", (40.0, 0.0), (40.0, 10.0)),
        Side("", (50.0, 10.0)),
        Side("top", (50.0, 100.0)),
        Side("axis", (0.0, 100.0)),
    ]
    foundation = [
        Side("base", (0.0, -200.0)),
        Side("", (100.0, -200.0)),
        Side("face", (100.0, 0.0)),
        Side("face", (43.0, 0.0)),
        Side("face", (30.0, 0.0)),
        Side("axis", (0.0, 0.0)),
    ]
    around = graded([(20.0, 0.0)], size, 12.0, 30.0, 150.0)
    near = graded([(40.0, 0.0)], edge, 12.0, 1.0, 60.0)
    bodies = {"punch": punch, "foundation": foundation}
    return write_outlines(folder / "punch.msh", bodies, lambda x: min(around(x), near(x)))


def punch_study(path: Path, mu: float = 0.0) -> dict[str, Any]:
    """The punch under the pressure 100; the probe is the middle of the foundation's top."""
    held = [("base", [0.0, 0.0]), ("axis", [0.0, None])]
    return steel_on_aluminium(
        path,
        "punch",
        mesh={"file": str(path), "axisymmetric": True},
        loads={
            "displacements": [{"on": on, "value": value} for on, value in held],
            "pressures": [{"on": "top", "value": 100.0}],
        },
        contact={"on": "sole", "against": "face"},
        friction=friction(mu),
        output={"probes": [{"points": [[0.0, -1e-9]]}]},
    )


def roller(folder: Path, fine: float) -> Path:
    """NAFEMS benchmark 1: the right half of a roller of radius 50, on a block."""
    roll = [
        Side("arc", (0.0, 0.0), (0.0, 50.0)),
        Side("", (50.0, 50.0), (0.0, 50.0)),
        Side("crown", (2.0, 50.0 + 2496.0**0.5), (0.0, 50.0)),
        Side("middle", (0.0, 100.0)),
        Side("middle", (0.0, 50.0)),
    ]
    block = [
        Side("middle", (0.0, 0.0)),
        Side("base", (0.0, -200.0)),
        Side("", (100.0, -200.0)),
        Side("face", (100.0, 0.0)),
    ]
    below, above = (
        graded([(0.0, 0.0)], fine, 10.0, 8.0, 80.0),
        graded([(0.0, 100.0)], 1.0, 10.0, 2.0, 40.0),
    )
    bodies = {"roll": roll, "block": block}
    return write_outlines(folder / "roller.msh", bodies, lambda x: min(below(x), above(x)))


def roller_study(path: Path, mu: float = 0.1, steps: int = 0) -> dict[str, Any]:
    """A half of the force 35 000 on the crown of the roller, at once or growing in steps."""
    held = [("base", [0.0, 0.0]), ("middle", [0.0, None])]
    force = "-17500*t" if steps else -17500.0
    study = steel_on_aluminium(
        path,
        "roll",
        loads={
            "displacements": [{"on": on, "value": value} for on, value in held],
            "forces": [{"on": "crown", "value": [0.0, force]}],
        },
        contact={"on": "face", "against": "arc"},
        friction=friction(mu),
        output={"probes": [{"points": [[0.0, 100.0]]}]},
    )
    return study | ({"steps": {"to": 1, "count": steps}} if steps else {})


def half_cylinder(name: str, up: float) -> Outlines:
    """A half cylinder that touches y = 0 at the origin, from above (1.0) or below (-1.0)."""
    centre = (0.0, up * RADIUS)
    left, right = (-RADIUS, up * RADIUS), (RADIUS, up * RADIUS)
    sides = [
        Side(f"arc_{name}", left, centre),
        Side(f"arc_{name}", (0.0, 0.0), centre),
        Side(f"flat_{name}", right),
    ]
    return {name: sides}


def cylinder_size(fine: float, ratio: float = 1.3) -> Size:
    """Cells of the size ``fine`` at the origin, and ``ratio`` times as large below it."""
    above = graded([(0.0, 0.0)], fine, 1.5, 1.0, 6.0)
    return lambda x: above(x) * (ratio if x[1] < 0.0 else 1.0)


def cylinders(folder: Path, fine: float, ratio: float = 1.0) -> Path:
    """Two equal half cylinders."""
    bodies = {**half_cylinder("upper", 1.0), **half_cylinder("lower", -1.0)}
    return write_outlines(folder / f"cylinders_{ratio}.msh", bodies, cylinder_size(fine, ratio))


def cylinder_study(path: Path, mu: float, down: Any, aside: Any = 0.0) -> dict[str, Any]:
    """The flat side of the upper cylinder is moved, and that of the lower body is held."""
    return {
        "mesh": {"file": str(path)},
        "material": {"elasticity": {"young": 200.0, "poisson": 0.3}},
        "loads": {
            "displacements": [
                {"on": "flat_lower", "value": [0.0, 0.0]},
                {"on": "flat_upper", "value": [aside, down]},
            ]
        },
        "contact": {"on": "arc_upper", "against": "arc_lower"},
        "friction": friction(mu),
    }


def pellet(folder: Path) -> Path:
    """A slice of height 2 of a pellet of radius 4.1 in its cladding, 4.12 < r < 4.75."""

    def slice_of(name: str, inner: float, outer: float) -> list[Side]:
        corners = [(inner, 0.0), (outer, 0.0), (outer, 2.0), (inner, 2.0)]
        names = ["ends", f"{name}_out", "ends", f"{name}_in"]
        return [Side(*pair) for pair in zip(names, corners, strict=True)]

    bodies = {"pellet": slice_of("pellet", 0.0, 4.1), "clad": slice_of("clad", 4.12, 4.75)}
    return write_outlines(folder / "pellet.msh", bodies, lambda x: 0.25 if x[0] < 4.11 else 0.18)


def pellet_study(path: Path) -> dict[str, Any]:
    """The pellet expands by 1 % into its cladding, between planes that hold both."""
    stiff = {"elasticity": {"young": 2e5, "poisson": 0.3}}
    heat = {"expansion": 1e-5, "temperature": "1000*t", "on": "pellet"}
    return {
        "mesh": {"file": str(path), "axisymmetric": True},
        "discretisation": {"degree": 2},
        "material": {
            "elasticity": {"young": 1e5, "poisson": 0.3},
            "regions": {"pellet": stiff},
            "eigenstrain": heat,
        },
        "loads": {"displacements": [{"on": "ends", "value": [None, 0.0]}]},
        "contact": {"on": "clad_in", "against": "pellet_out"},
        "friction": friction(0.3),
        "steps": {"times": [0.3, 0.5, 1.0]},
    }
