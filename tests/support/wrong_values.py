"""Values of keys and studies that are refused, with what is said of them."""

from __future__ import annotations

import math
from typing import Any

IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


def nested(key: str, value: Any) -> dict[str, Any]:
    """A mapping with ``value`` at a dotted key."""
    for part in reversed(key.split(".")):
        value = {part: value}
    return value


WRONG = [
    # material
    ("material.locking_limit", 0, "must be > 0"),
    ("material.locking_limit", -0.1, "not -0.1"),
    ("material.locking_limit", "-2*pi", "must be > 0"),
    ("material.locking_limit", "sin(q)", "unknown name 'q'"),
    ("material.locking_limit", "s", "unknown name 's'"),
    ("material.elasticity.young", 0, "must be > 0"),
    ("material.elasticity.poisson", 0.5, "must be < 0.5, not 0.5"),
    ("material.elasticity.poisson", -1, "must be > -1, not -1"),
    ("material.elasticity.lambda", 1, "mu: is missing beside lambda"),
    ("material.elasticity", {"lambda": 1, "mu": 0}, "mu: must be > 0"),
    ("material.elasticity", {"lambda": -1, "mu": 1}, r"2 lambda \+ 2 mu = 0 must be > 0 in 2D"),
    ("material.elasticity", {"young": 1, "mu": 1}, "not young, mu together"),
    ("material.elasticity.stiffness", [[1, 2], [2, 1]], "3x3, 4x4 or 6x6"),
    ("material.elasticity.stiffness", [[1, 0, 0], [0, 1], [0, 0, 1]], r"lengths \[3, 2, 3\]"),
    ("material.elasticity.stiffness", [], "3x3, 4x4 or 6x6"),
    (
        "material.elasticity.stiffness",
        [[1, 0, 0], [0.5, 1, 0], [0, 0, 1]],
        "not symmetric: row 1, column 2 is 0 but row 2, column 1 is 0.5",
    ),
    (
        "material.elasticity.stiffness",
        [[1, 2, 0], [2, 1, 0], [0, 0, 1]],
        "smallest eigenvalue is -1 ",
    ),
    ("material.elasticity.stiffness", [[1, 1, 0], [1, 1, 0], [0, 0, 1]], "not elliptic"),
    (
        "material.elasticity.stiffness",
        [[float(i == j) for i in range(6)] for j in range(6)],
        "must be 3x3 in 2D .*, not 6x6",
    ),
    ("material.regions.body.locking_limit", -1, "must be > 0"),
    ("material.regions.body.elasticity.young", -1, "must be > 0"),
    ("material.regions.core", {}, "no part of the body is named 'core'; there are body"),
    # loads
    ("loads.body_force", [1, 2, 3], "2 components in 2D, not 3"),
    ("loads.body_force", ["z", 0], "unknown name 'z'.* in 2D"),
    ("loads.body_force", 1, "must be a list"),
    ("loads.tractions", [{"on": "top", "value": [1]}], "0.value: must have 2 components"),
    ("loads.tractions", [{"on": "top"}], "0.value: is missing"),
    ("loads.tractions", [{"on": "top", "value": [0, 1]}] * 201, "201 entries; at most 200"),
    ("loads.tractions", [{"on": "topp", "value": [0, 1]}], r"'topp' \(did you mean 'top'\?\)"),
    ("loads.tractions", [{"on": 1, "value": [0, 1]}], "a name or a list of names, not 1"),
    ("loads.tractions", [{"on": ["top", "top"], "value": [0, 1]}], "more than once"),
    ("loads.tractions", [{"on": "top", "value": [None, 1]}], "not null"),
    ("loads.displacements", [{"on": "top", "value": [0, 0, 0]}], "must have 2 components"),
    ("loads.displacements", [{"on": "top", "value": [None, None]}], "fixes no component"),
    (
        "loads.displacements",
        [{"on": "top", "value": [0, None]}, {"on": ["left", "top"], "value": [1, 1]}],
        "1: component 0 on 'top' is prescribed by entry 0 already",
    ),
    ("loads.displacements", [{"on": "bottom", "value": [0, None]}], "must not overlap"),
    # output
    ("output.directory", "d" * 3901, "at most 3900 bytes"),
    ("study", {"vary": {f"k{k}": [1] for k in range(101)}}, "varies 101 keys; at most 100"),
    # contact
    ("contact.on", "botom", r"'botom' \(did you mean 'bottom'\?\); there are left, right"),
    ("contact.gap", math.inf, "finite"),
    ("contact.gap", "foo(x)", "unknown function 'foo'"),
    ("contact.foundation", {}, "exactly one of half_space, sphere, cylinder, expression"),
    (
        "contact.foundation",
        {
            "sphere": {"centre": [0, 0], "radius": 1},
            "cylinder": {"centre": [0, 0], "radius": 1},
        },
        "not sphere and cylinder",
    ),
    ("contact.foundation.sphere", {"centre": [0, 0], "radius": 0}, "radius: must be > 0"),
    ("contact.foundation.sphere", {"centre": [0], "radius": 1}, "centre: must have 2"),
    ("contact.foundation.half_space", {"point": [0, 0], "normal": [0, 0]}, "the zero vector"),
    ("contact.foundation.half_space", {"point": [0, 0, 1], "normal": [0, 1]}, "point: must have 2"),
    (
        "contact.foundation.cylinder",
        {"centre": [0, 0], "radius": 1, "axis": [0, 1, 0]},
        "axis: must be left out in 2D",
    ),
    (
        "contact",
        {"gap": 0.1, "foundation": {"sphere": {"centre": [0, 0], "radius": 1}}},
        "either gap or foundation",
    ),
    # friction
    ("friction.coefficient", -0.1, "must be >= 0"),
    ("friction.coefficient", "0.3*t", "unknown name 't'"),
    ("friction.coefficient", True, "a number or an expression, not true"),
    ("friction.smoothing.kernel", "convolve", r"\(did you mean 'convolution'\?\)"),
    ("friction.smoothing.radius", 0, "must be > 0"),
    # penalty, solver, output
    ("penalty.n", 0, "must be > 0"),
    ("penalty.n", -math.inf, "-.inf"),
    ("penalty.n", math.nan, "not .nan"),
    ("penalty.n", "many", "unknown name 'many'"),
    ("penalty.n", None, "must be a number, not null"),
    ("penalty.epsilon", -1, "must be > 0"),
    ("penalty.epsilon", math.inf, "must be a finite number"),
    ("solver.method", "newtonn", "must be auto, newton or interior_point"),
    ("solver.tolerance", 1, "must be < 1, not 1"),
    ("solver.max_iterations", 0, "must be >= 1, not 0"),
    ("solver.max_iterations", 1.5, "must be an integer, not 1.5"),
    ("solver.max_iterations", True, "must be an integer, not true"),
    ("solver.max_iterations", "7", "must be an integer, not '7'"),
    ("solver.max_iterations", 10**30, "must be <= 1000000000, not a huge integer"),
    ("penalty.n", 1e-200, "must be at least 1e-100"),
    ("solver.petsc", {"ksp_type": ["cg"]}, "must be a number, text"),
    ("solver.petsc", 1, "must be a mapping"),
    ("solver", "newton", "must be a mapping with keys among method"),
    ("output.fields", 1, "must be true or false"),
    ("output.directory", "", "must name a folder"),
    ("title", 2024, "must be text"),
    # mesh
    ("mesh.builder", "bloc", r"unknown geometry 'bloc' \(did you mean 'block'\?\)"),
    ("mesh.builder", 3, "unknown geometry 3"),
    ("mesh.hh", 1, r"unknown key \(did you mean 'h'\?\)"),
    ("mesh.h", -1, "h: must be positive"),
    ("mesh.h", [1], "must be a finite number"),
    ("mesh.dim", 4, "dim: must be 2 or 3"),
    ("mesh.size", [1, 1, 1], "size: "),
    ("mesh.size", 1, "size: must be a list in"),
    ("mesh.geometry", {}, "unknown key"),
    ("mesh", {"builder": "block", "file": __file__}, "builder: does not go with file"),
    ("mesh", {"h": 0.1, "file": __file__}, "h: does not go with file"),
    ("mesh.file", "none.msh", "there is no such file"),
    # unknown keys
    ("penalti", {}, r"unknown key \(did you mean 'penalty'\?\)"),
    ("mesh", {"builder": "annulus", "outer": 2}, r"\(did you mean 'outer_radius'\?\)"),
    ("contact", {"gap": 0, "1": None}, "take a decimal point, not a comma"),
    ("contact", {"0": {"gap": 0}}, "contact is one section and not a list"),
    ("locking_limit", 1, r"unknown key \(did you mean 'material.locking_limit'\?\)"),
    ("material.elasticity.yung", 1, r"\(did you mean 'young'\?\); known here: young, poisson"),
    # keys of other programs, and what is not modelled
    ("steps", {"to": 1, "n": 3}, r"\(did you mean 'count'\?\)"),
    ("contact.foundation", {"plane": 1}, r"\(did you mean 'half_space'\?\)"),
    ("mesh.builder", "rectangle", r"\(did you mean 'block'\?\)"),
    ("mesh.element_size", 0.1, r"\(did you mean 'h'\?\)"),
    ("contact.foundation", {"polyline": [[1, 0]]}, "has 1 entries; at least 2 are needed"),
    ("material.plasticity", {"yield_stress": 1}, "plasticity is not modelled"),
    ("contact.tied", True, "tied contact is not modelled"),
    ("contact.adhesion", 1, "adhesion is not modelled"),
    ("large_strain", True, "large strain and turns are not modelled"),
    ("material.regions.body.limit", 1, "known here: elasticity, locking_limit"),
]


STUDIES_WRONG = [
    ({}, "give the keys to vary"),
    ({"vary": {"penalty.m": [1]}}, "no key 'm' in penalty; known: n, epsilon"),
    ({"vary": {"penalti.n": [1]}}, r"no key 'penalti' \(did you mean 'penalty'\?\)"),
    ({"vary": {"mu": [1]}}, r"no key 'mu' \(did you mean 'friction.coefficient'\?\)"),
    ({"vary": {"penalty.n.x": [1]}}, "no key 'x' in penalty.n"),
    ({"vary": {"loads.tractions.first": [1]}}, "no key 'first'"),
    ({"vary": {"study.vary": [1]}}, "cannot vary itself"),
    ({"vary": {"penalty.n": 1}}, "must be a list of values"),
    ({"vary": {"penalty.n": []}}, "must be a list of values"),
    ({"vary": {"penalty.n": [math.nan]}}, "must not contain .nan"),
    ({"vary": {"penalty.n": {"geometric": [1, 10]}}}, r"a range is \[first, last, number"),
    ({"vary": {"penalty.n": {"geometric": [0, 10, 3]}}}, "needs numbers > 0"),
    ({"vary": {"penalty.n": {"linear": [0, 10, 2.5]}}}, "must be an integer"),
    ({"vary": {"penalty.n": {"quadratic": [1, 10, 3]}}}, "must be a list of values"),
    ({"vary": {"penalty.n": [1]}, "zip": {"penalty.n": [1]}}, "in both"),
    ({"vary": {"mesh": [{}], "mesh.h": [1]}}, "lies in another key"),
    ({"zip": {"mesh.h": [1, 2], "penalty.n": [1]}}, "mesh.h has 2, penalty.n has 1"),
    ({"vary": {"mesh.h": {"linear": [1, 2, 200]}, "penalty.n": {"linear": [1, 2, 200]}}}, "40000"),
    ({"vary": {"penalty.n": [1, -1]}}, "in the case penalty.n = -1: penalty.n: must be > 0"),
    ({"vary": {"loads.tractions.0.value": [[0, 1]]}}, "in the case"),
    # The misspelt key comes before the one that is missing for it.
    (
        {"vary": {"contact.foundation": [{"sphere": {"center": [0, -1], "radius": 1}}]}},
        r"sphere.center: unknown key \(did you mean 'centre'\?\)",
    ),
]
