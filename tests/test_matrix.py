"""What works with what: every pair of features of docs/reference/matrix.md, on tiny meshes.

A covering design has every pair of values in one of its problems at least.  Pairs that do not go
together are in `EXCLUDED`, with the key of the refusal, None where one has no meaning beside the
other: the table of the page is made of them.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import solved
from sweep.covering import Item, Row, design, pairs_in, pairs_of
from tool_files import ascii_stl

from contact_locking import from_mapping, solve
from contact_locking.errors import InputError

pytestmark = pytest.mark.serial

Study = dict[str, Any]
PAGE = Path(__file__).parents[1] / "docs" / "reference" / "matrix.md"

FEATURES: dict[str, tuple[str, ...]] = {
    "element": ("P1", "P2", "Q1"),
    "body": ("plane strain", "plane stress", "axisymmetric", "3D"),
    "contact": (
        *("half space", "sphere", "cylinder", "expression", "polyline", "surface", "height map"),
        *("gap", "two bodies", "many bodies", "two bodies, paired once"),
    ),
    "foundation": ("still", "moved", "pushed by a force", "on a spring"),
    "limit": ("none", "ball", "deviator", "volume", "direction", "weighted", "M(x)", "regions"),
    "friction": ("none", "constant", "mu(x)", "mu(s)"),
    "R": ("convolution", "helmholtz", "none"),
    "time": ("static", "steps"),
    "n": ("infinite", "finite"),
    "solver": ("direct", "iterative", "penalty"),
    "with": (
        *("nothing", "eigenstrain", "springs", "oblique supports", "total forces"),
        *("parts by place", "adaptive meshes", "derivatives"),
    ),
}
_BODIES = ("two bodies", "many bodies", "two bodies, paired once")
_NORMS = ("deviator", "volume", "direction", "weighted")
_MOVING = ("moved", "pushed by a force", "on a spring")

#: Pairs that do not go together, with the key that the refusal names.
EXCLUDED: dict[tuple[Item, Item], str | None] = {
    (("element", "Q1"), ("with", "adaptive meshes")): "adapt",
    (("body", "plane stress"), ("limit", "deviator")): "material.locking.0.norm",
    (("body", "plane stress"), ("limit", "volume")): "material.locking.0.norm",
    (("body", "axisymmetric"), ("contact", "cylinder")): "contact.foundation.cylinder",
    (("body", "axisymmetric"), ("contact", "surface")): "contact.foundation.surface",
    (("body", "axisymmetric"), ("contact", "height map")): "contact.foundation.surface",
    (("body", "axisymmetric"), ("with", "oblique supports")): None,
    (("body", "plane strain"), ("contact", "surface")): "contact.foundation.surface",
    (("body", "plane strain"), ("contact", "height map")): "contact.foundation.surface",
    (("body", "plane stress"), ("contact", "surface")): "contact.foundation.surface",
    (("body", "plane stress"), ("contact", "height map")): "contact.foundation.surface",
    (("body", "3D"), ("contact", "polyline")): "contact.foundation.polyline",
    (("contact", "gap"), ("foundation", "moved")): None,
    (("contact", "gap"), ("foundation", "pushed by a force")): None,
    (("contact", "gap"), ("foundation", "on a spring")): None,
    **{(("contact", a), ("foundation", b)): None for a in _BODIES for b in _MOVING},
    (("time", "steps"), ("with", "adaptive meshes")): "adapt",
    **{(("contact", bodies), ("with", "derivatives")): "contact.pair" for bodies in _BODIES[:2]},
    (("solver", "penalty"), ("n", "infinite")): "penalty.n",
    (("solver", "penalty"), ("element", "P2")): "discretisation.degree",
    (("solver", "penalty"), ("element", "Q1")): "mesh.cells",
    **{(("solver", "penalty"), ("contact", bodies)): "contact.against" for bodies in _BODIES},
    **{(("solver", "penalty"), ("foundation", tool)): "contact.foundation" for tool in _MOVING[1:]},
    **{(("solver", "penalty"), ("limit", limit)): "material.locking" for limit in _NORMS},
}


def agree(one: Item, other: Item) -> bool:
    return (one, other) not in EXCLUDED and (other, one) not in EXCLUDED


def solvable(row: Row) -> Row:
    """The row, with simplices where a block of hexahedra would have two regions."""
    has_hexahedra = row["element"] == "Q1" and row["body"] == "3D"
    is_one_block = row["limit"] == "regions" and row["contact"] not in _BODIES
    return row | ({"element": "P1"} if has_hexahedra and is_one_block else {})


ROWS = [solvable(row) for row in design(FEATURES, agree)[0]]


def study_of(row: Row, folder: Path) -> Study:
    """A block or two of about ten cells along each edge of 1, on a foundation; stresses are 1."""
    body, contact = row["body"], row["contact"]
    dim = 3 if body == "3D" else 2
    bodies = contact in _BODIES
    mesh: Study = {"builder": "stack" if bodies else "block", "dim": dim, "h": 0.5}
    if row["element"] == "Q1":
        mesh |= {"cells": "box", "structured": True}
    if body == "axisymmetric":
        mesh["axisymmetric"] = True
    if row["limit"] == "regions" and not bodies:
        mesh = {name: value for name, value in mesh.items() if name != "structured"}
        mesh |= {"builder": "inclusion", "radius": 0.4, "h": 0.4}
    material: Study = {"elasticity": {"young": 1.0, "poisson": 0.3}, **_limit(row["limit"], row)}
    if body == "plane stress":
        material["plane"] = "stress"
    up = [0.0] * (dim - 1)
    scale = "*t" if row["time"] == "steps" else ""
    shear = 0.0 if body == "axisymmetric" else f"0.001{scale}"
    pull = [shear, *up[1:], f"-0.005{scale}"]
    hold = "bottom" if bodies else "top"
    loads: Study = {"displacements": [{"on": hold, "value": [0.0] * dim}]}
    on_top = {"on": "top" if bodies else "right", "value": pull}
    loads["tractions"] = [on_top]
    if bodies:
        # Without friction nothing else holds the upper one.
        loads["springs"] = [{"on": "top", "stiffness": 0.02}]
    else:
        down = [shear, *up[1:], f"-0.004{scale}"]
        if row["foundation"] == "still":
            loads["displacements"] = [{"on": "top", "value": down}]
    study: Study = {"mesh": mesh, "material": material, "loads": loads}
    study["contact"] = _contact(row, dim, scale, folder)
    coefficients: Study = {
        "none": 0.0,
        "constant": 0.3,
        "mu(x)": "0.3 + 0.1*x",
        "mu(s)": "0.2 + 0.1/(1 + s/0.01)",
    }
    friction: Study = {
        "coefficient": coefficients[row["friction"]],
        "smoothing": {"kernel": row["R"]} | ({} if row["R"] == "none" else {"radius": 0.8}),
    }
    study["friction"] = friction
    study["discretisation"] = {"degree": 2 if row["element"] == "P2" else 1}
    study["penalty"] = {"n": math.inf if row["n"] == "infinite" else 1e4}
    solver = {"method": "penalty"} if row["solver"] == "penalty" else {"linear": row["solver"]}
    study["solver"] = solver
    if row["time"] == "steps":
        study["steps"] = {"to": 1.0, "count": 2}
    _with(row["with"], study, dim, hold)
    return study


def _limit(kind: str, row: Row) -> Study:
    M, dim = 0.02, 3 if row["body"] == "3D" else 2
    size = {"3D": 6, "axisymmetric": 4}.get(row["body"], 3)
    limits: Study = {
        "none": {},
        "ball": {"locking_limit": M},
        "M(x)": {"locking_limit": f"{M}*(1 + 0.2*x)"},
        "regions": {
            "locking_limit": M,
            "regions": {
                "upper" if row["contact"] in _BODIES else "inclusion": {"locking_limit": 0.5 * M}
            },
        },
        "deviator": {"locking": [{"norm": "deviator", "at_most": M}]},
        "volume": {"locking": [{"norm": "volume", "at_most": M, "at_least": -M}]},
        "direction": {
            "locking": [{"norm": "direction", "along": [1.0] * dim, "at_most": M, "at_least": -M}]
        },
        "weighted": {
            "locking": [{"norm": "weighted", "at_most": M, "matrix": np.eye(size).tolist()}]
        },
    }
    return dict(limits[kind])


def _contact(row: Row, dim: int, scale: str, folder: Path) -> Study:
    kind, motion = row["contact"], row["foundation"]
    flat = [0.0] * (dim - 1)
    if kind in _BODIES:
        pair = {"pair": "once"} if kind == _BODIES[2] else {}
        if kind == "many bodies":
            return {"on": ["upper_bottom", "lower_top"], "against": ["upper_bottom", "lower_top"]}
        return {"on": "upper_bottom", "against": "lower_top", **pair}
    if kind == "gap":
        return {"on": "bottom", "gap": 0.0}
    height = {2: "y", 3: "z"}[dim]
    middle = [0.0 if row["body"] == "axisymmetric" else 0.5, *[0.5] * (dim - 2)]
    centre = [*middle, -20.0]
    shapes: Study = {
        "half space": {"half_space": {"point": [0.0] * dim, "normal": [*flat, 1.0]}},
        "sphere": {"sphere": {"centre": centre, "radius": 20.0}},
        "cylinder": {"cylinder": {"centre": centre, "radius": 20.0}},
        "expression": {"expression": height},
        "polyline": {"polyline": [[3.0, 0.0], [-3.0, 0.0]]},
    }
    if kind == "surface":
        corners = [(-1.0, -1.0), (2.0, -1.0), (2.0, 2.0), (-1.0, 2.0)]
        a, b, c, d = (np.array([*corner, 0.0]) for corner in corners)
        (folder / "plane.stl").write_bytes(ascii_stl(np.array([[a, b, c], [a, c, d]])))
        shapes[kind] = {"surface": str(folder / "plane.stl")}
    if kind == "height map":
        np.save(folder / "plane.npy", np.zeros((4, 4)))
        about = {"spacing": [1.0, 1.0], "shift": [-1.0, -1.0, 0.0]}
        shapes[kind] = {"surface": {"file": str(folder / "plane.npy"), **about}}
    moved: Study = {
        "still": {},
        "moved": {"motion": [*flat, f"0.004{scale}"]},
        "pushed by a force": {"force": [*flat, f"0.004{scale}"]},
        "on a spring": {
            "spring": {"stiffness": 5.0},
            "force": [*flat, f"0.004{scale}"],
        },
    }
    return {"on": "bottom", "foundation": shapes[kind] | moved[motion]}


def _with(extra: str, study: Study, dim: int, hold: str) -> None:
    loads = study["loads"]
    if extra == "eigenstrain":
        study["material"]["eigenstrain"] = {"value": 0.001}
    elif extra == "springs":
        loads.setdefault("springs", []).append({"on": "right", "stiffness": 0.1})
    elif extra == "oblique supports":
        down = loads.pop("displacements")[0]["value"][-1]
        loads["supports"] = [{"on": hold, "along": [*[0.2] * (dim - 1), 1.0], "value": down}]
        loads.setdefault("springs", []).append({"on": "left", "stiffness": 0.1})
    elif extra == "total forces":
        traction = loads["tractions"].pop()
        loads["forces"] = [traction]
    elif extra == "parts by place":
        study["mesh"]["parts"] = {"held": {"on": hold}}
        loads["displacements"][0]["on"] = "held"
    elif extra == "adaptive meshes":
        study["adapt"] = {"max_meshes": 2, "tolerance": 1e-3}
    elif extra == "derivatives":
        study["sensitivities"] = {"of": ["compliance"], "to": ["material.elasticity.young"]}


def test_every_pair_of_features_is_in_a_problem_or_excluded() -> None:
    assert set().union(*map(pairs_in, ROWS)) == pairs_of(FEATURES, agree)


# Each third problem is solved by every run of the tests, and all of them with the slow ones.
@pytest.mark.parametrize(
    "row",
    [
        pytest.param(row, marks=[pytest.mark.slow] if number % 3 else [], id=str(number))
        for number, row in enumerate(ROWS)
    ],
)
def test_features_that_go_together_are_solved(row: Row, tmp_path: Path) -> None:
    solved(from_mapping(study_of(row, tmp_path)), MPI.COMM_SELF)


@pytest.mark.parametrize(
    ("pair", "key"), [(pair, key) for pair, key in EXCLUDED.items() if key is not None]
)
def test_features_that_do_not_go_together_are_refused_by_a_key(
    pair: tuple[Item, Item], key: str, tmp_path: Path
) -> None:
    # The method of the paper is for a finite n alone, which it would refuse first.
    n = {"n": "finite"} if ("solver", "penalty") in pair else {}
    row = {name: values[0] for name, values in FEATURES.items()} | n | dict(pair)
    with pytest.raises(InputError) as caught:
        solve(from_mapping(study_of(row, tmp_path)), MPI.COMM_SELF)
    assert key in f"{caught.value.key}: {caught.value}"


def test_the_page_has_every_feature_and_every_exception() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for name, values in FEATURES.items():
        (line,) = (line for line in text.splitlines() if line.startswith(f"| {name} |"))
        assert all(f"**{value}**" in line for value in values), name
    for (_, one), (_, other) in EXCLUDED:
        assert any(
            f"| {a} | " in line and b in line
            for line in text.splitlines()
            for a, b in ((one, other), (other, one))
        ), (one, other)
