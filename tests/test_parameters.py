"""Parameters: defaults, what is normalised, and every check that needs no mesh."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest

from contact_locking.errors import InputError
from contact_locking.meshes import BUILDERS
from contact_locking.parameters import MeshParameters, Parameters
from contact_locking.study_file import from_mapping, schema, schema_text
from contact_locking.study_file.listing import rows

pytestmark = pytest.mark.serial

IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


def nested(key: str, value: Any) -> dict[str, Any]:
    """A mapping with ``value`` at a dotted key."""
    for part in reversed(key.split(".")):
        value = {part: value}
    return value


def test_defaults_are_the_block_without_loads() -> None:
    parameters = Parameters()
    assert parameters == from_mapping({})
    assert parameters.mesh.builder == "block"
    assert parameters.mesh.dim == 2
    assert parameters.mesh.geometry.size == (1.0, 1.0)
    assert parameters.material.elasticity.young == 1.0
    assert parameters.material.elasticity.poisson == 0.3
    assert parameters.material.locking_limit == math.inf
    assert parameters.contact_names == ("bottom",)
    assert parameters.friction.coefficient == 0.0
    assert parameters.penalty.n == math.inf
    assert parameters.friction.regularisation is None
    assert parameters.penalty.epsilon is None
    assert parameters.study is None


def test_an_empty_section_has_its_defaults() -> None:
    sections = ["mesh", "material", "loads", "contact", "friction", "penalty", "solver", "output"]
    assert from_mapping(dict.fromkeys(sections)) == Parameters()


@pytest.mark.parametrize("value", [1e4, 10000, "1e4", "1.0e4", "2*5000", "10**4"])
def test_a_number_may_be_written_as_a_constant_expression(value: Any) -> None:
    assert from_mapping({"penalty": {"n": value}}).penalty.n == 1e4
    traction = {"on": "top", "value": [value, "x*y"]}
    assert from_mapping({"loads": {"tractions": [traction]}}).loads.tractions[0].value == (
        1e4,
        "x*y",
    )


def test_names_are_a_name_or_a_list() -> None:
    one = {"on": "left", "value": [0, None]}
    two = {"on": ["right", "top"], "value": [0, "x"]}
    loads = from_mapping({"loads": {"displacements": [one, two]}}).loads
    assert loads.displacements[0].on == ("left",)
    assert loads.displacements[0].value == (0.0, None)
    assert loads.displacements[1].on == ("right", "top")
    assert from_mapping({"contact": {"on": []}}).contact_names == ()


def test_each_way_to_give_the_elasticity() -> None:
    def elasticity(**given: Any) -> Any:
        return from_mapping({"material": {"elasticity": given}}).material.elasticity

    assert (elasticity(young=2).young, elasticity(young=2).poisson) == (2.0, 0.3)
    lame = elasticity(**{"lambda": 1, "mu": "1 + x"})
    assert (lame.lame_lambda, lame.lame_mu, lame.young) == (1.0, "1 + x", None)
    assert elasticity(stiffness=IDENTITY).stiffness == ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    mixed = [["1 + x", "y", 0], ["y", 2, 0], [0, 0, 1]]
    assert elasticity(stiffness=mixed).stiffness[0] == ("1 + x", "y", 0.0)


def test_a_builder_takes_its_own_parameters() -> None:
    mesh = from_mapping({"mesh": {"dim": 3, "size": [1, 2, "1/2"], "h": "1e-1"}}).mesh
    assert mesh.dim == 3
    assert mesh.geometry == BUILDERS["block"](dim=3, size=(1.0, 2.0, 0.5), h=0.1)  # type: ignore[call-arg]


@pytest.mark.parametrize("builder", BUILDERS)
def test_every_builder_has_defaults(builder: str) -> None:
    mesh = MeshParameters.model_validate({"builder": builder})
    assert mesh.geometry == BUILDERS[builder]()
    assert mesh.dim in (2, 3)


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
    ("material.regions.body.limit", 1, "known here: elasticity, locking_limit"),
]


@pytest.mark.parametrize(("key", "value", "message"), WRONG)
def test_a_wrong_value_is_refused_with_its_key(key: str, value: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        from_mapping(nested(key, value))
    text = str(caught.value)
    assert text.startswith(key) or re.match(key.rpartition(".")[0] or key, text)
    assert "\n" not in text
    assert "pydantic" not in text
    assert "Input should" not in text


def test_an_infinite_penalty_is_not_for_newton() -> None:
    given = {"penalty": {"n": math.inf}, "solver": {"method": "newton"}}
    with pytest.raises(InputError, match=r"take solver\.method: interior_point"):
        from_mapping(given)
    assert from_mapping({"penalty": {"n": math.inf}}).penalty.n == math.inf


def test_dimension_of_a_file_is_checked_when_it_is_known() -> None:
    loads = {"tractions": [{"on": "anything", "value": [0, 0, "z"]}]}
    parameters = from_mapping({"mesh": {"file": __file__}, "loads": loads})
    assert parameters.mesh.dim is None
    parameters.check_dimension(3)
    with pytest.raises(InputError, match="2 components in 2D") as caught:
        parameters.check_dimension(2)
    assert caught.value.key == "loads.tractions.0.value"


def test_ellipticity_depends_on_the_dimension() -> None:
    # 2 lambda + 2 mu = 0.2 > 0 but 3 lambda + 2 mu = -0.7 < 0
    elasticity = {"lambda": -0.9, "mu": 1}
    mesh = {"file": __file__}
    parameters = from_mapping({"mesh": mesh, "material": {"elasticity": elasticity}})
    parameters.check_dimension(2)
    with pytest.raises(InputError, match="not elliptic") as caught:
        parameters.check_dimension(3)
    assert caught.value.key == "material.elasticity.lambda"


def test_all_that_is_wrong_is_reported_at_once() -> None:
    with pytest.raises(InputError) as caught:
        from_mapping({"penalty": {"n": 0, "epsilon": 0}, "title": 1, "nonsense": 1})
    assert len(str(caught.value).splitlines()) == 4


STUDIES_WRONG = [
    ({}, "give the keys to vary"),
    ({"vary": {"penalty.m": [1]}}, "no key 'm' in penalty; known: n, epsilon"),
    ({"vary": {"penalti.n": [1]}}, r"no key 'penalti' \(did you mean 'penalty'\?\)"),
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


@pytest.mark.parametrize(("study", "message"), STUDIES_WRONG)
def test_a_study_that_cannot_run_is_refused(study: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        from_mapping({"study": study})
    assert str(caught.value).startswith("study")


def test_cases_of_a_study() -> None:
    study = {
        "vary": {"friction.coefficient": [0, "s"], "penalty.n": {"geometric": [10, 1000, 3]}},
        "zip": {"mesh.h": {"linear": [0.1, 0.2, 2]}, "solver.max_iterations": [7, 8]},
    }
    parameters = from_mapping({"study": study})
    assert parameters.study is not None
    cases = parameters.study.cases()
    assert len(cases) == 2 * 2 * 3
    keys = ("mesh.h", "solver.max_iterations", "friction.coefficient", "penalty.n")
    assert [tuple(case[key] for key in keys) for case in cases[:4]] == [
        (0.1, 7, 0, 10.0),
        (0.1, 7, 0, 100.0),
        (0.1, 7, 0, 1000.0),
        (0.1, 7, "s", 10.0),
    ]
    assert cases[-1]["mesh.h"] == 0.2


def test_every_key_has_a_description_and_a_default_or_is_required() -> None:
    table = list(rows())
    assert all(row.description for row in table)
    defaults = {row.key: row.default for row in table}
    assert defaults["material.locking_limit"] == ".inf"
    assert defaults["material.elasticity.lambda"] == "null"
    assert defaults["contact.foundation.sphere.radius"] == "required"
    units = {row.key: row.unit for row in table}
    assert units["mesh.h"] == "length"
    assert units["loads.tractions.INDEX.value"] == "stress"
    text = schema_text()
    assert all(row.key in text for row in table)


def test_schema_is_json_with_defaults_and_units() -> None:
    import json

    definition = schema()
    json.dumps(definition, allow_nan=False)
    n = definition["$defs"]["PenaltyParameters"]["properties"]["n"]
    assert (n["default"], n["unit"]) == (".inf", "stress")
    material = definition["$defs"]["MaterialParameters"]["properties"]
    assert material["locking_limit"]["default"] == ".inf"
    *kinds, empty = definition["$defs"]["MeshParameters"]["anyOf"]
    assert empty == {"type": "null"}
    builders = [kind["properties"].get("builder", {}).get("const") for kind in kinds]
    assert builders == [None, *BUILDERS]
    assert "unit" in kinds[1]["properties"]["h"]


def test_the_json_schema_has_the_bounds_of_numbers() -> None:
    sections = schema()["$defs"]

    def bounds(section: str, key: str) -> list[dict[str, Any]]:
        """The bounds of the numbers that the key may have."""
        about = sections[section]["properties"][key]
        choices = [about, *about.get("anyOf", []), *about.get("oneOf", [])]
        choices += [inner for choice in about.get("anyOf", []) for inner in choice.get("oneOf", [])]
        wanted = {"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "maxItems"}
        return [
            found for choice in choices if (found := {k: choice[k] for k in wanted & {*choice}})
        ]

    positive = [{"exclusiveMinimum": 0}]
    assert bounds("PenaltyParameters", "n") == positive
    assert bounds("PenaltyParameters", "epsilon") == positive
    assert bounds("Elasticity", "young") == positive
    assert bounds("Elasticity", "poisson") == [{"exclusiveMinimum": -1, "exclusiveMaximum": 0.5}]
    assert bounds("MaterialParameters", "locking_limit") == positive
    assert bounds("FrictionParameters", "coefficient") == [{"minimum": 0}]
    assert bounds("OwnFriction", "coefficient") == [{"minimum": 0}]
    assert bounds("SolverParameters", "max_iterations") == [{"minimum": 1, "maximum": 10**9}]
    assert bounds("SolverParameters", "tolerance") == [
        {"exclusiveMinimum": 0, "exclusiveMaximum": 1}
    ]
    assert bounds("LoadParameters", "tractions") == [{"maxItems": 200}]


def test_the_json_schema_takes_one_section_or_a_list_for_contact() -> None:
    one, several = schema()["properties"]["contact"]["oneOf"]
    assert one == several["items"] == {"$ref": "#/$defs/ContactSection"}
