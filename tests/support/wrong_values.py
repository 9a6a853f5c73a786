"""Values of keys and studies that are refused."""

from __future__ import annotations

import math
from typing import Any


def nested(key: str, value: Any) -> dict[str, Any]:
    """A mapping with ``value`` at a dotted key."""
    for part in reversed(key.split(".")):
        value = {part: value}
    return value


WRONG = [
    ("material.locking_limit", 0),
    ("material.locking_limit", -0.1),
    ("material.locking_limit", "-2*pi"),
    ("material.locking_limit", "sin(q)"),
    ("material.locking_limit", "s"),
    ("material.elasticity.young", 0),
    ("material.elasticity.poisson", 0.5),
    ("material.elasticity.poisson", -1),
    ("material.elasticity.lambda", 1),
    ("material.elasticity", {"lambda": 1, "mu": 0}),
    ("material.elasticity", {"lambda": -1, "mu": 1}),
    ("material.elasticity", {"young": 1, "mu": 1}),
    ("material.elasticity.stiffness", [[1, 2], [2, 1]]),
    ("material.elasticity.stiffness", [[1, 0, 0], [0, 1], [0, 0, 1]]),
    ("material.elasticity.stiffness", []),
    ("material.elasticity.stiffness", [[1, 0, 0], [0.5, 1, 0], [0, 0, 1]]),
    ("material.elasticity.stiffness", [[1, 2, 0], [2, 1, 0], [0, 0, 1]]),
    ("material.elasticity.stiffness", [[1, 1, 0], [1, 1, 0], [0, 0, 1]]),
    ("material.elasticity.stiffness", [[float(i == j) for i in range(6)] for j in range(6)]),
    ("material.regions.body.locking_limit", -1),
    ("material.regions.body.elasticity.young", -1),
    ("material.regions.core", {}),
    ("loads.body_force", [1, 2, 3]),
    ("loads.body_force", ["z", 0]),
    ("loads.body_force", 1),
    ("loads.tractions", [{"on": "top", "value": [1]}]),
    ("loads.tractions", [{"on": "top"}]),
    ("loads.tractions", [{"on": "top", "value": [0, 1]}] * 201),
    ("loads.tractions", [{"on": "topp", "value": [0, 1]}]),
    ("loads.tractions", [{"on": 1, "value": [0, 1]}]),
    ("loads.tractions", [{"on": ["top", "top"], "value": [0, 1]}]),
    ("loads.tractions", [{"on": "top", "value": [None, 1]}]),
    ("loads.displacements", [{"on": "top", "value": [0, 0, 0]}]),
    ("loads.displacements", [{"on": "top", "value": [None, None]}]),
    ("output.directory", "d" * 3901),
    ("study", {"vary": {f"k{k}": [1] for k in range(101)}}),
    ("contact.on", "botom"),
    ("contact.gap", math.inf),
    ("contact.gap", "foo(x)"),
    ("contact.foundation", {}),
    (
        "contact.foundation",
        {"sphere": {"centre": [0, 0], "radius": 1}, "cylinder": {"centre": [0, 0], "radius": 1}},
    ),
    ("contact.foundation.sphere", {"centre": [0, 0], "radius": 0}),
    ("contact.foundation.sphere", {"centre": [0], "radius": 1}),
    ("contact.foundation.half_space", {"point": [0, 0], "normal": [0, 0]}),
    ("contact.foundation.half_space", {"point": [0, 0, 1], "normal": [0, 1]}),
    ("contact.foundation.cylinder", {"centre": [0, 0], "radius": 1, "axis": [0, 1, 0]}),
    ("contact", {"gap": 0.1, "foundation": {"sphere": {"centre": [0, 0], "radius": 1}}}),
    ("friction.coefficient", -0.1),
    ("friction.coefficient", "0.3*t"),
    ("friction.coefficient", True),
    ("friction.smoothing.kernel", "convolve"),
    ("friction.smoothing.radius", 0),
    ("penalty.n", 0),
    ("penalty.n", -math.inf),
    ("penalty.n", math.nan),
    ("penalty.n", "many"),
    ("penalty.n", None),
    ("penalty.epsilon", -1),
    ("penalty.epsilon", math.inf),
    ("solver.method", "newtonn"),
    ("solver.tolerance", 1),
    ("solver.max_iterations", 0),
    ("solver.max_iterations", 1.5),
    ("solver.max_iterations", True),
    ("solver.max_iterations", "7"),
    ("solver.max_iterations", 10**30),
    ("penalty.n", 1e-200),
    ("solver.petsc", {"ksp_type": ["cg"]}),
    ("solver.petsc", 1),
    ("solver", "penalty"),
    ("output.fields", 1),
    ("output.directory", ""),
    ("title", 2024),
    ("mesh.builder", "bloc"),
    ("mesh.builder", 3),
    ("mesh.hh", 1),
    ("mesh.h", -1),
    ("mesh.h", [1]),
    ("mesh.dim", 4),
    ("mesh.size", [1, 1, 1]),
    ("mesh.size", 1),
    ("mesh.geometry", {}),
    ("mesh", {"builder": "block", "file": __file__}),
    ("mesh", {"h": 0.1, "file": __file__}),
    ("mesh.file", "none.msh"),
    ("penalti", {}),
    ("mesh", {"builder": "annulus", "outer": 2}),
    ("contact", {"gap": 0, "1": None}),
    ("contact", {"0": {"gap": 0}}),
    ("locking_limit", 1),
    ("material.elasticity.yung", 1),
    ("steps", {"to": 1, "n": 3}),
    ("contact.foundation", {"plane": 1}),
    ("mesh.builder", "rectangle"),
    ("mesh.element_size", 0.1),
    ("contact.foundation", {"polyline": [[1, 0]]}),
    ("material.plasticity", {"yield_stress": 1}),
    ("contact.tied", True),
    ("contact.adhesion", 1),
    ("large_strain", True),
    ("material.regions.body.limit", 1),
]


STUDIES_WRONG = [
    {},
    {"vary": {"penalty.m": [1]}},
    {"vary": {"penalti.n": [1]}},
    {"vary": {"mu": [1]}},
    {"vary": {"penalty.n.x": [1]}},
    {"vary": {"loads.tractions.first": [1]}},
    {"vary": {"study.vary": [1]}},
    {"vary": {"penalty.n": 1}},
    {"vary": {"penalty.n": []}},
    {"vary": {"penalty.n": [math.nan]}},
    {"vary": {"penalty.n": {"geometric": [1, 10]}}},
    {"vary": {"penalty.n": {"geometric": [0, 10, 3]}}},
    {"vary": {"penalty.n": {"linear": [0, 10, 2.5]}}},
    {"vary": {"penalty.n": {"quadratic": [1, 10, 3]}}},
    {"vary": {"penalty.n": [1]}, "zip": {"penalty.n": [1]}},
    {"vary": {"mesh": [{}], "mesh.h": [1]}},
    {"zip": {"mesh.h": [1, 2], "penalty.n": [1]}},
    {"vary": {"mesh.h": {"linear": [1, 2, 200]}, "penalty.n": {"linear": [1, 2, 200]}}},
    {"vary": {"penalty.n": [1, -1]}},
    {"vary": {"loads.tractions.0.value": [[0, 1]]}},
    {"vary": {"contact.foundation": [{"sphere": {"center": [0, -1], "radius": 1}}]}},
]


def parts(**new: Any) -> dict[str, Any]:
    return {"mesh": {"parts": {"new": new}}}


def locking(**limit: Any) -> dict[str, Any]:
    return {"mesh": {"dim": 2}, "material": {"locking": [limit]}}


def eigenstrain(**given: Any) -> dict[str, Any]:
    return {"material": {"eigenstrain": given}}


def foundation(shape: dict[str, Any], dim: int = 2) -> dict[str, Any]:
    return {"mesh": {"dim": dim}, "contact": {"foundation": shape}}


def motion(given: Any) -> dict[str, Any]:
    return {"steps": {"to": 1, "count": 2}} | foundation(HALF | {"motion": given})


def turned(section: str, given: dict[str, Any]) -> dict[str, Any]:
    return {"mesh": {"builder": "block", "axisymmetric": True}, section: given}


def stretched(**material: Any) -> dict[str, Any]:
    return {"material": {"plane": "stress"} | material}


def probes(*given: Any) -> dict[str, Any]:
    return {"output": {"probes": list(given)}}


def springs(**given: Any) -> dict[str, Any]:
    return {"loads": {"springs": [{"on": "bottom", "stiffness": 1.0} | given]}}


HALF = {"half_space": {"point": [0, 0], "normal": [0, 1]}}
SPHERE = {"sphere": {"centre": [0, -1], "radius": 1}}
BALL = {"norm": "strain", "at_most": 0.1}
LINE = {"from": [0, 0], "to": [1, 0]}
IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
SECTIONS_WRONG: list[tuple[str, Any]] = [
    ("contact", {"contact": 3}),
    ("contact.0", {"contact": [3]}),
    ("contact.1.gapp", {"contact": [{}, {"gapp": 1}]}),
    ("contact.1.on", {"contact": [{}, {"on": "botom"}]}),
    # What only scripts give has no key.
    ("contact.0.at", {"contact": [{"at": "a"}]}),
    ("contact.0.<at>", {"contact": [{"<at>": "a"}]}),
    ("contact.1.gap", {"contact": [{}, {"gap": "z"}]}),
    ("contact.1.gap", {"contact": [{}, {"gap": 1, "foundation": SPHERE}]}),
    ("contact.0.friction.coefficient", {"contact": [{"friction": {"coefficient": -1}}]}),
    ("contact.0.friction.mu", {"contact": [{"friction": {"mu": 1}}]}),
    (
        "contact.friction.smoothing.kernel",
        {"contact": {"friction": {"smoothing": {"kernel": "convolve"}}}},
    ),
    ("contact.0", {"contact": {"0": {"gap": 1}}}),
    ("contact", {"contact": [{}] * 101}),
    ("contact.name", {"contact": {"name": ""}}),
    ("contact.name", {"contact": {"name": "a.b"}}),
    ("study", {"contact": [{}], "study": {"vary": {"contact.gap": [0]}}}),
    ("study", {"contact": [{}], "study": {"vary": {"contact.1.gap": [0]}}}),
    ("study.vary.contact.0.gapp", {"contact": [{}], "study": {"vary": {"contact.0.gapp": [0]}}}),
    ("study.vary.contact.0.0.gap", {"contact": [{}], "study": {"vary": {"contact.0.0.gap": [0]}}}),
    ("contact.foundation.polyline", foundation({"polyline": {"<only>": [[0, 0], [1, 0]]}})),
    ("contact.foundation.polyline", foundation({"polyline": [[0, 0], [1, 0]]}, 3)),
    ("contact.foundation.polyline", foundation({"polyline": [[0, 0]]})),
    ("contact.foundation.polyline.1", foundation({"polyline": [[0, 0], [1, 0, 0]]})),
    ("contact.foundation.expression", foundation({"expression": "z"})),
    ("contact.foundation.expression", foundation({"expression": "y*t"})),
    ("contact.foundation.surface", foundation({"surface": __file__}, 2)),
    (
        "contact.foundation.surface.scale",
        foundation({"surface": {"file": __file__, "scale": 0}}, 3),
    ),
    ("contact.foundation.surface.file", foundation({"surface": {"scale": 2}}, 3)),
    ("contact.foundation.surface.fil", foundation({"surface": {"fil": "tool.stl"}}, 3)),
    ("contact.foundation.force", foundation(HALF | {"force": [0, 0]})),
    ("contact.foundation.force", foundation(HALF | {"force": [0, 0, -1]})),
    ("contact.foundation.motion", motion([0, 0, 0])),
    ("contact.foundation.motion.1", motion([0, "x"])),
    ("contact.foundation.motion", motion({})),
    ("contact.foundation.motion.about", motion({"rotation": "t"})),
    ("contact.foundation.motion.rotation", motion({"rotation": [0, 0, "t"], "about": [0, 0]})),
    ("contact.foundation.motion.angle", motion({"about": [0, 0], "angle": 1})),
    ("mesh.parts.new", parts()),
    ("mesh.parts.new.facing", parts(facing=[0, 0, 1])),
    ("mesh.parts.new.facing", parts(facing=[0, 0])),
    ("mesh.parts.new.skin", parts(skin="both")),
    ("mesh.parts.new.box", parts(box=[[1, 0], [0, 1]])),
    ("mesh.parts.new.box.0", parts(box=[[0, 0, 0], [1, 1]])),
    ("mesh.parts.new.expression", parts(expression="x + 1")),
    ("mesh.parts.new.expression", parts(expression="z < 1")),
    ("mesh.parts.new.expression", parts(expression=1)),
    ("mesh.parts.new.on", parts(on="botom")),
    ("mesh.parts.new.plane.normal", parts(plane={"point": [0, 0], "normal": [0, 0]})),
    ("mesh.axisymmetric", {"mesh": {"builder": "ball", "axisymmetric": True}}),
    ("mesh.axisymmetric", {"mesh": {"builder": "block", "dim": 3, "axisymmetric": True}}),
    ("mesh.quarter", {"mesh": {"builder": "annulus", "axisymmetric": True}}),
    ("mesh.axisymmetric", {"mesh": {"builder": "block", "axisymmetric": 1}}),
    ("material.plane", turned("material", {"plane": "stress"})),
    ("material.elasticity.stiffness", turned("material", {"elasticity": {"stiffness": IDENTITY}})),
    (
        "material.locking.0.along",
        turned("material", {"locking": [{"norm": "direction", "along": [1], "at_most": 1}]}),
    ),
    (
        "contact.foundation.cylinder",
        turned("contact", {"foundation": {"cylinder": {"centre": [0, -1], "radius": 1}}}),
    ),
    ("contact.foundation.motion.0", turned("contact", {"foundation": HALF | {"motion": [0.1, 0]}})),
    ("material.locking.0.norm", locking(norm="shear", at_most=1)),
    ("material.locking.0", locking(norm="volume")),
    ("material.locking.0.at_most", locking(norm="deviator")),
    ("material.locking.0.at_most", locking(norm="deviator", at_most=0)),
    ("material.locking.0.at_least", locking(norm="volume", at_least=0.001)),
    ("material.locking.0.at_least", locking(norm="strain", at_most=1, at_least=-1)),
    ("material.locking.0.along", locking(norm="direction", at_most=1)),
    ("material.locking.0.along", locking(norm="direction", along=[0, 0], at_most=1)),
    ("material.locking.0.along", locking(norm="direction", along=[0, 0, 1], at_most=1)),
    ("material.locking.0.along", locking(norm="volume", along=[1, 0], at_most=1)),
    ("material.locking.0.matrix", locking(norm="weighted", at_most=1)),
    ("material.locking.0.matrix", locking(norm="weighted", matrix=[[0] * 3] * 3, at_most=1)),
    ("material.locking.0.matrix", locking(norm="weighted", matrix=[[0] * 6] * 6, at_most=1)),
    ("material.locking", {"material": {"locking": [BALL, BALL]}}),
    ("material.locking", {"material": {"locking": [BALL], "locking_limit": 0.2}}),
    ("material.locking.0.norm", stretched(locking=[{"norm": "volume", "at_most": 0.1}])),
    ("material.locking.0.norm", stretched(locking=[{"norm": "deviator", "at_most": 0.1}])),
    ("material.elasticity.stiffness", stretched(elasticity={"stiffness": IDENTITY})),
    ("material.elasticity.lambda", stretched(elasticity={"lambda": -0.7, "mu": 1.0})),
    ("material.plane", stretched() | {"mesh": {"dim": 3}}),
    ("material.eigenstrain", eigenstrain()),
    ("material.eigenstrain", eigenstrain(value=1.0, expansion=1.0)),
    ("material.eigenstrain.temperature", eigenstrain(value=0.1, temperature=3.0)),
    ("material.eigenstrain.temperature", eigenstrain(expansion=1e-5)),
    ("material.eigenstrain.value", eigenstrain(value=[0.1])),
    ("material.eigenstrain.value.1.0", eigenstrain(value=[[0.1, 0.2], [0.3, 0.1]])),
    ("material.eigenstrain.value", eigenstrain(value=[[0.1, 0.2], 0.3])),
    ("material.eigenstrain.value", eigenstrain(value=[[0.1, 0.2, 0.0]] * 2)),
    ("material.eigenstrain.value.0.2", eigenstrain(value=[[1, 0, 1], [0, 1, 0], [1, 0, 1]])),
    ("material.eigenstrain.on", eigenstrain(value=0.1, on="core")),
    ("material.eigenstrain.value", eigenstrain(value="0.1*t")),
    ("material.eigenstrain.value", eigenstrain(value="0.1*z")),
    ("loads.springs.0.stiffness", springs(stiffness=0)),
    ("loads.springs.0.along", springs(along=[1])),
    ("loads.springs.0.on", springs(on="nowhere")),
    ("output.probes.0", probes({})),
    ("output.probes.0.points.0", probes({"points": [[0, 0, 0]]})),
    ("output.probes.0.line.to", probes({"line": {"from": [0, 0], "to": [1, 0, 0], "count": 3}})),
    ("output.probes.0.line.count", probes({"line": LINE | {"count": 1}})),
    ("output.probes", probes(*[{"line": LINE | {"count": 9000}}] * 2)),
]
