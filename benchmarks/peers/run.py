"""The same problems by several programs: benchmarks/peers/results.md, which this script writes.

    CONTACT_LOCKING_PACKAGES=benchmarks/peers/debian-packages.txt ./in-env \
        python3 benchmarks/peers/run.py

Every solve is a process of its own, one after the other, on one thread; one that takes longer than
five minutes is stopped.  Times are CPU seconds of the solve alone, without the set-up of its model.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import peer_problems as problems
from exchange import Problem, read

HERE = Path(__file__).resolve().parent
SECONDS = 300
PENALTIES = ("1e2", "1e4", "1e6", "1e8", "inf")
# GRECO's values and those of code_aster's tests ssnv128a (penalised) and ssnv128m (continuous), in
# units of 1e-5 m, at the distances x in mm from the corner.
PLATE = {
    "GRECO": (2.86, 2.72, 2.28, 1.98, 1.50),
    "code_aster, penalised (ssnv128a)": (2.865, 2.727, 2.292, 1.993, 1.561),
    "code_aster, continuous (ssnv128m)": (2.846, 2.708, 2.274, 1.973, 1.536),
}
PLACES = (0.0, 1.25, 5.0, 7.5, 11.25)
HERTZ = (0.681, 9.35)


@dataclass(frozen=True)
class Peer:
    """A program with its settings; ``penalised`` ones are run for every n, others for n = inf."""

    name: str
    script: str
    options: tuple[str, ...] = ()
    penalised: bool = False


OURS = Peer("contact_locking", "contact_locking_run", ("method=interior_point",), penalised=True)
PAPER = Peer("contact_locking, penalty", "contact_locking_run", ("method=penalty",), penalised=True)
PENALTY = Peer("GetFEM, penalty", "getfem_contact", ("contact=penalty",), penalised=True)
STEPPED = Peer(
    "GetFEM, penalty, n x 10", "getfem_contact", ("contact=penalty", "factor=10"), penalised=True
)
NODAL = Peer("GetFEM, augmented Lagrangian, nodal", "getfem_contact", ("contact=nodal",))
INTEGRAL = Peer("GetFEM, augmented Lagrangian, integral", "getfem_contact", ("contact=integral",))
CLARABEL = Peer("Clarabel", "clarabel_conic")
BOUNDS = Peer("PETSc, vinewtonrsls", "petsc_bounds")
TWO_BODIES = Peer("GetFEM, augmented Lagrangian, integral", "getfem_two_bodies")
PRESSED = Peer(
    *("GetFEM, augmented Lagrangian, ray tracing", "getfem_two_bodies"),
    ("contact=raytracing", "down=0.02"),
)
EXACT = Peer("contact_locking", "contact_locking_run", ("method=interior_point", "n=inf"))
PROXIMAL = Peer("proximal Galerkin", "proximal")


def locking(factor: int) -> Peer:
    """GetFEM with exact contact and a penalised strain limit, n raised in steps."""
    name = f"GetFEM, augmented Lagrangian, n x {factor}"
    return Peer(name, "getfem_contact", ("contact=nodal", f"factor={factor}"), penalised=True)


RUNS: dict[str, tuple[Peer, ...]] = {
    "hertz": (OURS, PENALTY, STEPPED, NODAL, INTEGRAL, CLARABEL, BOUNDS, PROXIMAL),
    "block": (OURS, PAPER, PENALTY, STEPPED, NODAL, INTEGRAL, CLARABEL),
    "plate": (OURS, PENALTY, STEPPED, NODAL, INTEGRAL, CLARABEL),
    "stack": (OURS, TWO_BODIES),
    **dict.fromkeys(("punch", "roller", "roller_friction"), (EXACT, PRESSED)),
    "locking": (OURS, PAPER, locking(10), locking(2), CLARABEL),
    "smooth": (
        *(OURS, PAPER, locking(10), locking(2), CLARABEL),
        Peer("proximal Galerkin", "proximal", ("factor=2", "alpha=0.1", "longest=4")),
    ),
}


class Measure:
    """Norms of displacements on the mesh of a problem."""

    def __init__(self, problem: Problem, reference: Any) -> None:
        self.problem, self.reference = problem, reference
        edges = problem.x[problem.cells[:, 1:]] - problem.x[problem.cells[:, :1]]
        others = np.linalg.inv(edges)
        self._gradients = np.concatenate([-others.sum(axis=2, keepdims=True), others], axis=2)
        self._areas = np.abs(np.linalg.det(edges)) / 2.0

    def strain_norm(self, u: Any) -> Any:
        """|eps(u)| in every cell."""
        gradient = np.einsum("cds,csi->cid", self._gradients, u[self.problem.cells])
        strain = 0.5 * (gradient + gradient.transpose(0, 2, 1))
        return np.sqrt((strain**2).sum(axis=(1, 2)))

    def size(self, u: Any) -> float:
        """|eps(u)| in L2."""
        return float(np.sqrt(self._areas @ self.strain_norm(u) ** 2))

    def error(self, u: Any) -> float:
        """The relative distance to the reference solution."""
        return self.size(u - self.reference) / self.size(self.reference)

    def penetration(self, u: Any) -> float:
        """The deepest one, in lengths of the body."""
        place = (self.problem.x + u)[self.problem.contact_nodes(), 1]
        return max(0.0, -float(place.min()))


def solve(peer: Peer, source: Path, n: str, folder: Path) -> tuple[Any, dict[str, Any]]:
    """One solve in a process of its own: the displacement, or None, and the facts."""
    result = folder / "result.npz"
    result.unlink(missing_ok=True)
    command = [sys.executable, str(HERE / f"{peer.script}.py"), str(source), str(result)]
    command += [*peer.options, *([f"n={n}"] if peer.penalised else [])]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "HWLOC_HIDE_ERRORS": "2"}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=SECONDS, env=environment
        )
    except subprocess.TimeoutExpired:
        return None, {"reason": f"stopped after {SECONDS} s"}
    if not result.exists():
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        return None, {"reason": last[:60]}
    with np.load(result) as file:
        return file["u"], json.loads(str(file["facts"]))


def measured(problem: Problem, name: str, u: Any, facts: dict[str, Any]) -> list[str]:
    """The displacement at the probe in mm, and pressure and friction in MPa and N/mm."""
    against = problem.against if name == "punch" else None
    nodes = problem.nodes(against or "crown")
    away = np.linalg.norm(problem.x[nodes] - problems.PROBES[name], axis=1)
    down = u[nodes[away.argmin()], 1]
    return [f"{down:.5f}", f"{70e3 * facts['pressure']:.0f}", f"{70e3 * facts['friction']:.1f}"]


def rows_of(name: str, folder: Path) -> list[list[str]]:
    """The table of a problem."""
    source = folder / f"{name}.npz"
    measure = Measure(read(source), np.load(folder / f"{name}-reference.npy"))
    limit = measure.problem.limit
    rows = []
    for peer in RUNS[name]:
        for n in PENALTIES if peer.penalised else ("",):
            if n == "inf" and peer not in (OURS,):
                continue
            u, facts = solve(peer, source, n, folder)
            print(name, peer.name, n, facts, file=sys.stderr, flush=True)
            if u is None:
                rows.append([peer.name, n, f"no: {facts['reason']}", "", "", "", ""])
                continue
            over = float(measure.strain_norm(u).max()) / limit - 1.0
            rows.append(
                [
                    peer.name,
                    n or "exact",
                    "yes" if facts["converged"] else "**no**",
                    str(facts["iterations"]),
                    f"{facts['seconds']:.2f}",
                    f"{measure.error(u):.0e}",
                    "" if measure.problem.against else f"{measure.penetration(u):.0e}",
                    *([f"{max(0.0, over):.0e}"] if np.isfinite(limit) else []),
                    *(
                        [*measured(measure.problem, name, u, facts)]
                        if name in problems.PROBES
                        else []
                    ),
                ]
            )
    return rows


def table(header: list[str], rows: list[list[str]]) -> list[str]:
    """In Markdown, the columns lined up."""
    rows = [[*row, *[""] * (len(header) - len(row))][: len(header)] for row in rows]
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [header, ["-" * width for width in widths], *rows]
    return ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in lines]


def published(solutions: dict[str, Any]) -> list[str]:
    """SSNV128 and Hertz beside published numbers."""
    x, u = problems.displaced(solutions["plate"])
    found = []
    for place in PLACES:
        nearest = np.argmin(np.hypot(x[:, 0] - place / 40.0, x[:, 1]))
        found.append(0.04 * u[nearest, 0] / 1e-5)
    rows = [[name, *(f"{value:.3f}" for value in values)] for name, values in PLATE.items()]
    rows.append(["contact_locking, n = inf", *(f"{value:.3f}" for value in found)])
    lines = table(["u_x in 1e-5 m at x =", *(f"{place:g} mm" for place in PLACES)], rows)
    hertz = solutions["hertz"]
    half = 8.0 * hertz.summary["contact_area"]
    peak = 200.0 * float(hertz.contact_points.pressure.max())
    values = [
        ["Hertz's formula", *map(str, HERTZ)],
        ["contact_locking", f"{half:.3f}", f"{peak:.2f}"],
    ]
    return [*lines, "", *table(["cylinder", "half-width", "peak pressure"], values)]


def code_lines(script: str) -> int:
    """Lines that are neither blank, nor comments, nor of the docstring at the top."""
    text = (HERE / f"{script}.py").read_text(encoding="utf-8").split('"""', 2)[2]
    return sum(
        bool(line.strip()) and not line.strip().startswith("#") for line in text.splitlines()
    )


def versions() -> str:
    """The programs with their versions."""
    found = []
    for name in ("getfem", "clarabel", "fenics-dolfinx", "petsc4py"):
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            asked = {"getfem": "python3-getfem", "fenics-dolfinx": "python3-dolfinx-real"}
            command = ["dpkg-query", "-W", "-f", "${Version}", asked.get(name, f"python3-{name}")]
            done = subprocess.run(command, capture_output=True, text=True)
            found.append(f"{name} {done.stdout or '?'}")
    return ", ".join(found)


def main() -> None:
    """Solve all, or the problems that are named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", nargs="*", default=list(RUNS), help="of " + ", ".join(RUNS))
    parser.add_argument(
        "--divisions", type=int, default=32, help="1/h of the blocks, not the plate"
    )
    given = parser.parse_args()
    for name in ("block", "stack", "locking", "smooth"):
        problems.STUDIES[name]["mesh"]["h"] = 1.0 / given.divisions
    machine = f"{os.cpu_count()} cores, {platform.machine()}, load {os.getloadavg()[0]:.1f}"
    lines = ["# Measured by `benchmarks/peers/run.py`", ""]
    lines += [
        f"{machine} at the start; {versions()}.",
        "",
    ]
    solutions = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name in given.problems:
            solutions[name] = problems.write(name, folder)
            header = ["program", "n", "converges", "tangents", "s", "error", "penetration"]
            header += ["overstrain"] if name in ("locking", "smooth") else []
            if name in problems.PROBES:
                header += ["u_y in mm", "peak pressure in MPa", "friction in N/mm"]
            unknowns = solutions[name].summary["dofs"]
            lines += [
                f"## {name}: {unknowns} unknowns",
                "",
                *table(header, rows_of(name, folder)),
                "",
            ]
    if {"plate", "hertz"} <= set(solutions):
        lines += ["## Beside published numbers", "", *published(solutions), ""]
    others = ("clarabel_conic", "petsc_bounds", "proximal", "dolfinx_body")
    scripts = ("getfem_contact", "getfem_two_bodies", *others)
    counts = [[f"{name}.py", str(code_lines(name))] for name in scripts]
    lines += ["## Lines of code", "", *table(["script", "lines"], counts), ""]
    (HERE / "results.md").write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
