"""The problems and the answers as files, so that every program solves on the same mesh.

A problem is ``NAME.npz``: linear triangles, named boundary parts, loads and the foundation y <= 0.
A peer is a script that is called with a problem, a result file, and options of the form
``name=value``; each peer reads the problem and writes its displacement here.  The module needs
NumPy only.
"""

from __future__ import annotations

import json
import math
import sys
import time
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Problem:
    """A body of linear triangles above the rigid foundation y <= 0, in plane strain, or two bodies.

    ``parts`` holds the facets (f, 2) of each boundary part as numbers of nodes.  ``tractions`` are
    forces per length by part.  ``held`` are the components that are zero on each part.  The part
    ``contact`` may touch the foundation with Coulomb's coefficient ``friction``, or the part
    ``against`` of a second body.  ``study`` is the same problem as a study file has it.
    """

    x: Any
    cells: Any
    parts: dict[str, Any]
    young: float
    poisson: float
    limit: float
    friction: float
    contact: str
    against: str | None
    young_against: float  # Young's modulus of the second body
    tractions: dict[str, list[float]]
    held: dict[str, list[int]]
    study: dict[str, Any]
    bound: Any  # the friction bound of the reference solution at each node, for a frozen bound

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's lambda and mu."""
        return self.lame_of(self.young)

    def lame_of(self, young: float) -> tuple[float, float]:
        """Lame's lambda and mu for another Young's modulus."""
        shear = young / (2.0 * (1.0 + self.poisson))
        return 2.0 * shear * self.poisson / (1.0 - 2.0 * self.poisson), shear

    def nodes(self, part: str) -> Any:
        """The nodes of a part."""
        return np.unique(self.parts[part])

    def held_dofs(self) -> Any:
        """The held degrees of freedom, 2 i + j for the component j of the node i."""
        each = [2 * self.nodes(part) + j for part, of in self.held.items() for j in of]
        return np.unique(np.concatenate(each))

    def contact_nodes(self) -> Any:
        """The nodes that may touch: those of the part without nodes held in y."""
        held = self.held_dofs()
        return np.setdiff1d(self.nodes(self.contact), held[held % 2 == 1] // 2)

    def load(self) -> Any:
        """The nodal forces (k, 2)."""
        force = np.zeros(self.x.shape)
        for part, traction in self.tractions.items():
            facets = self.parts[part]
            lengths = np.linalg.norm(self.x[facets[:, 1]] - self.x[facets[:, 0]], axis=1)
            np.add.at(force, facets, 0.5 * lengths[:, None, None] * np.array(traction))
        return force

    def save(self, path: Path) -> None:
        """Write the arrays and the numbers."""
        kept = ("young", "poisson", "limit", "friction", "contact", "against", "young_against")
        loads = ("tractions", "held", "study")
        facts = json.dumps({name: getattr(self, name) for name in (*kept, *loads)})
        arrays = {f"part_{name}": facets for name, facets in self.parts.items()}
        np.savez(path, x=self.x, cells=self.cells, bound=self.bound, facts=facts, **arrays)


def read(path: str | Path) -> Problem:
    """The problem of a file."""
    with np.load(path) as file:
        parts = {name[5:]: file[name] for name in file.files if name.startswith("part_")}
        facts = json.loads(str(file["facts"]))
        return Problem(file["x"], file["cells"], parts, bound=file["bound"], **facts)


@dataclass
class Task:
    """What a peer is called with, and the clock of its solve."""

    source: Path
    result: Path
    options: dict[str, str]
    began: float = field(default_factory=time.process_time)
    ended: float = math.nan

    @cached_property
    def problem(self) -> Problem:
        """The problem of the file."""
        return read(self.source)

    def number(self, name: str, default: float = math.inf) -> float:
        """An option that is a number."""
        return float(self.options.get(name, default))

    def start(self) -> None:
        """Start the clock: the mesh and the model are there, the solve begins."""
        self.began = time.process_time()

    def stop(self) -> None:
        """Stop the clock; `finish` does so otherwise."""
        self.ended = time.process_time()

    def finish(self, u: Any, iterations: int, converged: bool, **measured: float) -> None:
        """Write the displacement (k, 2) in the order of the problem's nodes, and the facts.

        ``measured`` are the ``pressure``, the largest one, and the total ``friction``.
        """
        if math.isnan(self.ended):
            self.stop()
        facts = {
            "iterations": int(iterations),
            "converged": bool(converged) and bool(np.isfinite(u).all()),
            "seconds": self.ended - self.began,
            **{name: float(value) for name, value in measured.items()},
        }
        np.savez(self.result, u=np.reshape(u, (-1, 2)), facts=json.dumps(facts))


def task() -> Task:
    """The task of this process: ``PEER.py PROBLEM.npz RESULT.npz [name=value ...]``."""
    problem, result, *options = sys.argv[1:]
    return Task(Path(problem), Path(result), dict(option.split("=") for option in options))
