"""Parameters: defaults, what is normalised, the cases of a study, and the schema of all keys."""

from __future__ import annotations

from typing import Any

import pytest
from mpi4py import MPI
from problems import SEVERAL, material
from ruamel.yaml import YAML

from contact_locking.errors import InputError
from contact_locking.meshes import BUILDERS
from contact_locking.running.assembly import assemble
from contact_locking.study_file import dump, from_mapping, schema, schema_text
from contact_locking.study_file.parameters.problem import MeshParameters
from contact_locking.study_file.parameters.wording import labels
from contact_locking.study_file.schema import rows

pytestmark = pytest.mark.serial


@pytest.mark.parametrize("value", [1e4, 10000, "1e4", "1.0e4", "2*5000", "10**4"])
def test_a_number_may_be_written_as_a_constant_expression(value: Any) -> None:
    assert from_mapping({"penalty": {"n": value}}).penalty.n == 1e4
    traction = {"on": "top", "value": [value, "x*y"]}
    (read,) = from_mapping({"loads": {"tractions": [traction]}}).loads.tractions
    assert [part.data for part in read.value] == [1e4, "x*y"]


@pytest.mark.parametrize("builder", BUILDERS)
def test_every_builder_has_defaults(builder: str) -> None:
    mesh = MeshParameters.model_validate({"builder": builder})
    assert mesh.geometry == BUILDERS[builder]()
    assert mesh.dim in (2, 3)


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
    on = [definition["$defs"][name]["properties"]["on"] for name in ("Contact", "Support")]
    assert on[0]["default"] == ["bottom"] and "default" not in on[1]


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
    assert bounds("PenaltyParameters", "epsilon") == [{"minimum": 0}]
    assert bounds("Elasticity", "young") == positive
    assert bounds("Elasticity", "poisson") == [{"exclusiveMinimum": -1, "exclusiveMaximum": 0.5}]
    assert bounds("MaterialParameters", "locking_limit") == positive
    assert bounds("Coulomb", "coefficient") == [{"minimum": 0}]
    assert bounds("Settings", "max_iterations") == [{"minimum": 1, "maximum": 10**9}]
    assert bounds("Settings", "tolerance") == [{"exclusiveMinimum": 0, "exclusiveMaximum": 1}]
    assert bounds("LoadParameters", "tractions") == [{"maxItems": 200}]


@pytest.mark.parametrize(
    ("limit", "key"),
    [
        ({"norm": "deviator", "at_most": "x - 0.5"}, "at_most"),
        ({"norm": "volume", "at_least": "0.5 - x"}, "at_least"),
        ({"norm": "direction", "along": ["0*x", "0*x"], "at_most": 0.1}, "along"),
        ({"norm": "direction", "along": ["1/0", 1], "at_most": 0.1}, "along.0"),
    ],
)
def test_limits_that_fail_on_the_mesh_are_refused_with_their_key(
    limit: dict[str, Any], key: str
) -> None:
    with pytest.raises(InputError) as caught:
        assemble(from_mapping({"mesh": {"h": 0.3}, "material": material(limit)}), MPI.COMM_WORLD)
    assert f"material.locking.0.{key}" in f"{caught.value.key} {caught.value}"


def test_a_list_of_limits_is_written_and_read_back() -> None:
    given = from_mapping({"material": {"locking": SEVERAL}})
    again = from_mapping(YAML(typ="safe").load(dump(given)))
    assert again == given


def test_the_label_of_a_case_names_every_key_that_varies() -> None:
    rows = [{"title": 80 * "x" + end, "penalty.n": n} for end in "ab" for n in (10, 20)]
    assert labels(rows)[1].endswith(" (value 1), penalty.n = 20")
    assert len(set(labels(rows))) == 4
    assert labels([{"a": [{"b": n}]} for n in (1, 2)]) == ["a = [{b: 1}]", "a = [{b: 2}]"]
