"""The answer to a problem as plain numbers, to compare with the answer to a transformed problem.

A study on a block is written to files in any unit, position, numbering and naming.  The answer to
this transformed problem is transformed back: nodal and cell values, integrals and verdicts.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from msh import write_msh
from scipy.spatial import cKDTree
from sweep.case import Study
from sweep.transforms import Transform

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.fem import compiled
from contact_locking.process import solving
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters

# A value below this share of its scale is zero with rounding.
_ROUNDING = 1e-9
# A state is a tie where the pressure, or the distance of the traction to its bound, is a smaller
# share than this of the largest pressure.
_TIE = 1e-6
_SLIP_SHARE = 0.99


@dataclass(frozen=True)
class Block:
    """Points (k, d) and the elements of each group by numbers of points from 0."""

    points: FloatArray
    groups: dict[str, IntArray]

    @classmethod
    def unit(cls, dim: int, parts: int) -> Block:
        """The unit square or cube in ``parts^d`` cubes of d! simplices each.

        Sides have the names of the builder's; the cells are "stiff" for x > 1/2, else "soft".
        Nodes are moved off the grid, each within its side: a grid may look the same in two ways.
        """
        strides = (parts + 1) ** np.arange(dim)[::-1]
        points = np.array(list(product(range(parts + 1), repeat=dim))) / parts
        within = (points > 0.0) & (points < 1.0)
        shifts = np.random.default_rng(7).uniform(-0.2, 0.2, points.shape) / parts
        points = points + np.where(within, shifts, 0.0)
        steps = [
            np.cumsum([0, *(strides[axis] for axis in order)]) for order in permutations(range(dim))
        ]
        corners = np.array(list(product(range(parts), repeat=dim))) @ strides
        cells = np.array([corner + step for corner in corners for step in steps])
        stiff = points[cells][:, :, 0].mean(axis=1) > 0.5
        groups = {"soft": cells[~stiff], "stiff": cells[stiff]}
        sides = [("left", "right"), ("front", "back"), ("bottom", "top")]
        for axis, names in enumerate([sides[0], *sides[3 - dim + 1 :]]):
            for value, name in enumerate(names):
                on = points[cells][:, :, axis] == value
                held = on.sum(axis=1) == dim
                groups[name] = cells[held][on[held]].reshape(-1, dim)
        return cls(points, groups)

    def renumbered(self, random: np.random.Generator) -> Block:
        """The block with nodes, elements and the corners of each element in another order."""
        order = random.permutation(len(self.points))
        number = np.argsort(order)
        groups = {
            name: random.permuted(random.permutation(number[elements]), axis=1)
            for name, elements in self.groups.items()
        }
        return Block(self.points[order], groups)

    def relabelled(self, names: dict[str, str]) -> Block:
        """The block with other names of groups in another order, which gives other tags."""
        groups = {names[name]: self.groups[name] for name in reversed(self.groups)}
        return Block(self.points, groups)

    def write(self, path: Path, transform: Transform) -> Path:
        groups = {
            name: [[int(i) + 1 for i in element] for element in elements]
            for name, elements in self.groups.items()
        }
        points = [[float(c) for c in point] for point in transform.places(self.points)]
        return write_msh(path, points, groups)


@dataclass(frozen=True)
class Answer:
    """The answer to a problem; the same on every rank.

    ``fields`` (k, ...) are by the nodes or cells of ``places``, integrals and maxima ``numbers``;
    ``scales`` is, of each of them, what rounding is measured by.  ``ties`` are the nodes where two
    states are as good.
    """

    places: dict[str, FloatArray]
    fields: dict[str, FloatArray]
    numbers: dict[str, FloatArray]
    verdicts: dict[str, Any]
    tangents: int
    ties: BoolArray
    scales: dict[str, float]

    def require_same(self, other: Answer, tolerance: float) -> None:
        """Raise AssertionError where the other answer differs by more, relative to the largest."""
        assert other.verdicts == self.verdicts
        assert abs(other.tangents - self.tangents) <= 2, (other.tangents, self.tangents)
        apart = self.apart(other)
        worst = {name: value for name, value in apart.items() if not value <= tolerance}
        assert not worst, f"{worst} beyond {tolerance:g}"
        states, others = self.fields["state"], other.fields["state"][self._order(other, "nodes")]
        different = (states != others) & ~self.ties
        assert not different.any(), (states[different], others[different])

    def apart(self, other: Answer) -> dict[str, float]:
        """The largest difference of each field and number, relative to its largest value."""
        found = {}
        for name in {**self.fields, **self.numbers}.keys() - {"state"}:
            if name in self.numbers:
                mine, yours = self.numbers[name], other.numbers[name]
            else:
                where = "cells" if name in ("strain_norm", "locking_stress") else "nodes"
                mine, yours = self.fields[name], other.fields[name][self._order(other, where)]
            size = max(float(np.abs(mine).max()), _ROUNDING * self.scales[name])
            difference = float(np.abs(yours - mine).max())
            found[name] = difference / size if difference > 0.0 else 0.0
        return found

    def _order(self, other: Answer, where: str) -> IntArray:
        """The rows of the other answer in the order of this one."""
        distance, rows = cKDTree(other.places[where]).query(self.places[where])
        assert distance.max() < 1e-6
        assert len(set(rows)) == len(other.places[where]) == len(rows)
        return np.asarray(rows, dtype=np.int64)


def answer_of(
    study: Study,
    block: Block,
    path: Path,
    transform: Transform | None = None,
) -> Answer:
    """Transform a study on a block, solve it from files, and transform its answer back; collective.

    ``path`` is the mesh file to write.
    """
    transform = transform or Transform.of(np.eye(block.points.shape[1]))
    data = copy.deepcopy(transform.study(study))
    data["mesh"] = {"file": str(block.write(path, transform))}
    return told(solving.solve(Parameters.model_validate(data)), transform)


def told(solution: StudySolution, transform: Transform) -> Answer:
    """The answer that a solution of a transformed problem gives to the problem; collective.

    At n = inf the locking stress is a multiplier, which in 3D is not unique: a tetrahedron that
    locks is one condition, and there are five of them for the three components of a node.  Rounding
    by 1e-16 then chooses within 1e-5.  The forces that it exerts on nodes are unique.
    """
    Q, comm = transform.matrix, solution.domain.comm
    dim, summary = len(Q), solution.summary
    length, move = transform.length, transform.length * transform.load
    stress = transform.stress * transform.load
    energy, force = stress * move * length ** (dim - 1), stress * length ** (dim - 1)

    # The nodal forces of the locking stress, at free nodes.
    v = ufl.TestFunction(solution.displacement.function_space)
    pull = fem.Function(solution.displacement.function_space)
    work = ufl.inner(solution.locking_stress, ufl.sym(ufl.grad(v))) * ufl.dx
    fem.assemble_vector(pull.x.array, compiled.form(work))
    pull.x.scatter_reverse(la.InsertMode.add)
    for condition in solution.parameters.loads.displacements:
        facets = solution.domain.facets(condition.on)
        pull.x.array[_dofs(pull.function_space, facets)] = 0.0

    def gathered(function: Any) -> tuple[FloatArray, FloatArray]:
        space = function.function_space
        owned = space.dofmap.index_map.size_local
        x = space.tabulate_dof_coordinates()[:owned, :dim] @ Q / length
        values = function.x.array.reshape(-1, space.dofmap.bs)[:owned]
        return np.concatenate(comm.allgather(x)), np.concatenate(comm.allgather(values))

    nodes, u = gathered(solution.displacement)
    cells, norms = gathered(solution.strain_norm)
    tensors = gathered(solution.locking_stress)[1].reshape(-1, dim, dim)
    elastic = float(np.abs(gathered(solution.elastic_stress)[1]).max()) / stress

    def on_nodes(function: Any) -> FloatArray:
        # Another space may number the nodes in another way.
        x, values = gathered(function)
        return np.asarray(values[cKDTree(x).query(nodes)[1]])

    pressure = on_nodes(solution.contact_pressure)[:, 0] / stress
    traction = on_nodes(solution.tangential_traction) @ Q / stress
    bound = on_nodes(solution.friction_bound)[:, 0] / stress
    fields = {
        "displacement": u @ Q / move,
        "strain_norm": norms / transform.load,
        "locking_stress": np.einsum("ki,ckm,mj->cij", Q, tensors, Q) / stress,
        "pressure": pressure,
        "traction": traction,
        "bound": bound,
        "locking_force": gathered(pull)[1] @ Q / force,
        "state": on_nodes(solution.contact_state)[:, 0].round(),
    }
    if dim == 3 and math.isinf(solution.parameters.penalty.n):
        del fields["locking_stress"]
    numbers: dict[str, FloatArray] = {
        "elastic_energy": np.array([summary["elastic_energy"]]) / energy,
        "compliance": np.array([summary["compliance"]]) / energy,
        "contact_force": np.asarray(summary["contact_force"] @ Q / force, dtype=np.float64),
        "friction_force": np.asarray(summary["friction_force"] @ Q / force, dtype=np.float64),
        "strain_norm_max": np.array([summary["strain_norm_max"]]) / transform.load,
    }
    size = float(np.abs(fields["displacement"]).max())
    work = float(numbers["elastic_energy"][0])
    scales = dict.fromkeys([*fields, *numbers], elastic)
    scales |= {"displacement": size, "elastic_energy": work, "compliance": work}
    scales |= dict.fromkeys(["strain_norm", "strain_norm_max"], float(np.abs(norms).max()))
    peak = float(pressure.max(initial=0.0))
    to_bound = np.linalg.norm(traction, axis=1) - _SLIP_SHARE * bound
    ties = (pressure < _TIE * peak) | (np.abs(to_bound) < _TIE * peak)
    verdicts = {
        "converged": summary["converged"],
        "bounds": {name: entry["holds"] for name, entry in summary["bounds"].items()},
        "criteria": {
            name: entry["holds"] for name, entry in summary["certificate"]["criteria"].items()
        },
        "warnings": len(summary["warnings"]),
    }
    tangents = int(summary["iterations"]["tangents"])
    places = {"nodes": nodes, "cells": cells}
    return Answer(places, fields, numbers, verdicts, tangents, ties, scales)


def _dofs(space: fem.FunctionSpace, facets: Any) -> IntArray:
    """All components at the nodes of some facets, on the rank that has them; collective."""
    mesh = space.mesh
    blocks = fem.locate_dofs_topological(space, mesh.topology.dim - 1, facets)
    return np.asarray((blocks[:, None] * mesh.geometry.dim + np.arange(mesh.geometry.dim)).ravel())


def rotation(*angles: float) -> FloatArray:
    """The rotation by one angle in 2D, or by angles about the three axes in 3D."""
    if len(angles) == 1:
        c, s = math.cos(angles[0]), math.sin(angles[0])
        return np.array([[c, -s], [s, c]])
    Q = np.eye(3)
    for axis, angle in enumerate(angles):
        plane = np.eye(3)
        rows = np.ix_([(axis + 1) % 3, (axis + 2) % 3], [(axis + 1) % 3, (axis + 2) % 3])
        plane[rows] = rotation(angle)
        Q = plane @ Q
    return Q
