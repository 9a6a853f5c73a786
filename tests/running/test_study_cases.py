"""The cases of any study file that is accepted have names, labels, files and rows of the table."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from study_folder import STUDY

from contact_locking import study_file
from contact_locking.errors import InputError
from contact_locking.running.cases import Outcome, cases_of, row_of

pytestmark = pytest.mark.serial

INF, NAN = float("inf"), float("nan")
#: Values that a key can have; now and then it gets those of another.
VALUES: dict[str, list[Any]] = {
    "title": ["", "a", "1e3", "a: b", "\0", "None", "é"],
    "mesh.h": [0.5, 1, "1/3", 1e-9, 0],
    "mesh": [{"builder": "block"}, {"builder": "disc", "radius": 2}, {}],
    "material.locking_limit": [0.05, INF, "0.1 + x", "x +"],
    "loads.tractions.0.value": [[0, 1], [None, "x*y"], [0]],
    "loads.tractions.0.value.1": [0, -1e300, "sin(x)"],
    "friction.coefficient": [0, 0.3, "0.3 + s", -1],
    "penalty.n": [1, 1e4, INF, NAN, {"a": 1}],
    "solver.petsc": [{}, {"ksp_type": "cg"}, {"a": None, "b": True, "c": 1}],
    "output.picture": [True, False, "yes"],
    "study": [{}],
}
ANY = st.sampled_from([value for values in VALUES.values() for value in values])
RANGES = st.sampled_from([{"geometric": [1, 8, 4]}, {"linear": [0, 1, 3]}, {"linear": [1, INF, 2]}])


def _lists(key: str) -> st.SearchStrategy[Any]:
    own = st.lists(st.sampled_from(VALUES[key]), min_size=1, max_size=3)
    return st.tuples(st.just(key), own | own | own | st.lists(ANY, max_size=3) | RANGES)


ENTRIES = st.lists(st.sampled_from(list(VALUES)).flatmap(_lists), max_size=2).map(dict)
STUDIES = st.fixed_dictionaries({}, optional={"vary": ENTRIES, "zip": ENTRIES})


@settings(max_examples=50, deadline=None)
@given(study=STUDIES)
def test_any_study_has_cases_or_is_refused(
    study: Any, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "mutated.yml"
    path.write_text(
        f"{STUDY}study: {json.dumps(study)}\n".replace("Infinity", ".inf").replace("NaN", ".nan")
    )
    try:
        cases = cases_of(study_file.load(path))
    except InputError as error:
        assert str(path) in str(error)
        return
    assert cases
    for case in cases:
        assert "\n" not in case.label
        saved = path.with_name("case.yml")
        saved.write_text(study_file.dump(case.parameters), encoding="utf-8")
        again = study_file.load(saved).parameters
        assert again == case.parameters
        assert study_file.fingerprint(again) == case.name
        json.dumps(row_of(case.values, case.name, Outcome("not run")), allow_nan=False).encode()
