"""The data a user can give: each way to say the same thing gives the same solution."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from problems import block, solved
from verification_table import Rows

from contact_locking import study_file
from contact_locking.laws.body import isotropic_stiffness, lame_from_young
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial


def _same(first: Parameters, second: Parameters, tolerance: float = 1e-8) -> None:
    a, b = solved(first).summary, solved(second).summary
    for key in ("compliance", "elastic_energy", "strain_norm_max", "locked_fraction"):
        assert a[key] == pytest.approx(b[key], rel=tolerance), key
    for key in ("contact_force", "friction_force"):
        assert a[key] == pytest.approx(b[key], rel=tolerance, abs=1e-9), key


LAME = lame_from_young(1.0, 0.3)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    "elasticity",
    [{"lambda": LAME[0], "mu": LAME[1]}, {"young": "1 + 0*x", "poisson": "0.3"}, "stiffness"],
    ids=["lame", "expressions", "stiffness"],
)
def test_isotropic_elasticity_can_be_given_in_every_way(dim: int, elasticity: Any) -> None:
    h = 0.2 if dim == 2 else 0.5
    if elasticity == "stiffness":
        elasticity = {"stiffness": isotropic_stiffness(*LAME, dim).tolist()}
    _same(block(dim, h), block(dim, h, material__elasticity=elasticity))


def _inclusion(material: dict[str, Any]) -> Parameters:
    return block(mesh={"builder": "inclusion", "dim": 2, "h": 0.1}, material=material)


def test_a_region_and_an_expression_say_the_same() -> None:
    stiff = {"elasticity": {"young": 10.0, "poisson": 0.3}, "locking_limit": math.inf}
    soft = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02}
    inside = "(x - 0.5)**2 + (y - 0.5)**2 < 0.25**2"
    varied = {
        "elasticity": {"young": f"10 if {inside} else 1", "poisson": 0.3},
        "locking_limit": f"inf if {inside} else 0.02",
    }
    _same(_inclusion({**soft, "regions": {"inclusion": stiff}}), _inclusion(varied))


@pytest.mark.slow
def test_v14_four_ranks_agree_with_one(tmp_path: Path, found: Rows) -> None:
    file = tmp_path / "block.yml"
    file.write_text(study_file.dump(block(h=0.1, penalty__n=math.inf)))
    run = [sys.executable, "-m", "contact_locking", "run", str(file), "--quiet"]
    summaries = []
    for ranks in (1, 4):
        output = tmp_path / str(ranks)
        launcher = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
        subprocess.run([*launcher, *run, "--output", str(output)], check=True, timeout=240)
        summaries.append(json.loads((output / "summary.json").read_text()))
    one, four = summaries
    assert (one["ranks"], four["ranks"]) == (1, 4)
    for key in ("compliance", "elastic_energy", "strain_norm_max"):
        where = "block on four ranks beside one"
        found.add("V14", where, key.replace("_", " "), four[key], one[key])
        assert four[key] == pytest.approx(one[key], rel=1e-8)
    assert four["contact_force"] == pytest.approx(one["contact_force"], rel=1e-8, abs=1e-12)
