"""A study file as a model of UM-Bridge."""

from __future__ import annotations

import json
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from ruamel.yaml import YAML

import contact_locking as cl
from contact_locking.inverse.sensitivities import with_values
from contact_locking.inverse.um_bridge import Model

pytestmark = pytest.mark.serial

STUDY = """
parameters: {mu: 0.3, pull: 0.007}
mesh: {builder: block, dim: 2, size: [1.0, 1.0], h: 0.25}
material:
  elasticity: {young: 1.0, poisson: 0.3}
  locking_limit: 0.03
loads:
  displacements:
    - {on: left, value: [0, 0]}
  tractions:
    - {on: top, value: [0, -0.08*(1 - x)]}
    - {on: right, value: [0, "pull"]}
contact: {on: bottom, gap: 0.002}
friction: {coefficient: "mu", smoothing: {kernel: convolution, radius: 0.3}}
penalty: {n: .inf}
solver: {tolerance: 1e-10, friction_tolerance: 1e-11}
sensitivities:
  of: [contact_force.1, compliance]
  to: [parameters.mu, parameters.pull, material.locking_limit]
"""
AT = [0.35, 0.006, 0.028]


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    file = tmp_path_factory.mktemp("served") / "study.yml"
    file.write_text(STUDY)
    words = [sys.executable, "-m", "contact_locking", "serve", str(file), "--port=0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().split()[0]
        process.terminate()


def ask(url: str, other: Any = None, **request: Any) -> Any:
    """The answer to a request, or to ``other`` JSON, or the error of one that is refused."""
    data = json.dumps(other or {"name": "forward", **request}).encode()
    try:
        with urllib.request.urlopen(urllib.request.Request(url, data), timeout=60) as answer:
            return json.loads(answer.read())
    except urllib.error.HTTPError as error:
        assert error.code == 400
        return json.loads(error.read())["error"]


def test_a_model_says_what_it_takes_and_returns(url: str) -> None:
    with urllib.request.urlopen(f"{url}/Info", timeout=60) as answer:
        assert json.loads(answer.read()) == {"protocolVersion": 1.0, "models": ["forward"]}
    support = {"Evaluate": True, "Gradient": True, "ApplyJacobian": True, "ApplyHessian": False}
    assert ask(f"{url}/ModelInfo") == {"support": support}
    assert ask(f"{url}/InputSizes") == {"inputSizes": [3]}
    assert ask(f"{url}/OutputSizes") == {"outputSizes": [2]}


def test_values_are_those_of_a_solve_also_on_another_mesh(url: str) -> None:
    keys = ("parameters.mu", "parameters.pull", "material.locking_limit")
    data = YAML(typ="safe").load(STUDY)
    for config in ({}, {"mesh.h": 0.5}):
        values = {**dict(zip(keys, AT, strict=True)), **config}
        expected = cl.solve(with_values(cl.from_mapping(data), values)).summary
        (answered,) = ask(f"{url}/Evaluate", input=[AT], config=config)["output"]
        assert answered[0] == pytest.approx(expected["contact_force"][1], rel=1e-8)
        assert answered[1] == pytest.approx(expected["compliance"], rel=1e-8)


def test_gradients_are_differences_of_values(url: str) -> None:
    width = 1e-5
    columns = []
    for unit in np.eye(3):
        sides = [
            ask(f"{url}/Evaluate", input=[(np.array(AT) + side * width * unit).tolist()])
            for side in (1, -1)
        ]
        above, below = (np.array(side["output"][0]) for side in sides)
        columns.append((above - below) / (2 * width))
    jacobian = np.array(columns).T
    wrt = {"inWrt": 0, "outWrt": 0, "input": [AT]}
    gradient = ask(f"{url}/Gradient", sens=[2.0, -1.0], **wrt)["output"]
    assert gradient == pytest.approx(np.array([2.0, -1.0]) @ jacobian, rel=1e-4)
    along = ask(f"{url}/ApplyJacobian", vec=[1.0, 2.0, 3.0], **wrt)["output"]
    assert along == pytest.approx(jacobian @ [1.0, 2.0, 3.0], rel=1e-4)


@pytest.mark.parametrize(
    ("path", "request_"),
    [
        ("Evaluate", {"input": [[0.3]]}),
        ("Evaluate", {"input": [AT, AT]}),
        ("Evaluate", {"input": [["a", "b", "c"]]}),
        ("Evaluate", {"input": 3}),
        ("Evaluate", {"input": [AT], "config": [1]}),
        ("Evaluate", {"other": [1]}),
        ("Gradient", {"input": [AT], "sens": None}),
        ("Evaluate", {"input": [[-1.0, 0.006, 0.02]]}),  # a friction coefficient below zero
        ("Evaluate", {"input": [AT], "config": {"mesh.none": 1}}),
        ("Evaluate", {"input": [AT], "config": {"mesh.file": "/etc/passwd"}}),
        ("Evaluate", {"input": [AT], "name": "backward"}),
        ("Evaluate", {}),
        ("Gradient", {"input": [AT], "sens": [1.0]}),
        ("ApplyHessian", {"input": [AT]}),
    ],
)
def test_a_wrong_request_is_answered_by_an_error(
    url: str, path: str, request_: dict[str, Any]
) -> None:
    refused = ask(f"{url}/{path}", **request_)
    assert refused["message"] and refused["type"] in ("InputError", "KeyError")
    assert ask(f"{url}/InputSizes") == {"inputSizes": [3]}  # the server goes on


@pytest.mark.parametrize(("key", "value"), [("sensitivities", None), ("adapt", {"tolerance": 0.1})])
def test_a_study_that_no_server_can_answer_for_is_refused(key: str, value: Any) -> None:
    data = {**YAML(typ="safe").load(STUDY), key: value}
    with pytest.raises(cl.InputError) as refused:
        Model(cl.from_mapping(data), MPI.COMM_SELF)
    assert refused.value.key == key


def test_a_study_without_a_solution_is_an_error_that_says_why(url: str) -> None:
    refused = ask(f"{url}/Evaluate", input=[AT], config={"solver.max_iterations": 1})
    assert refused["type"] == "NotConverged" and refused["message"]
