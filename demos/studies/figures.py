"""The figures and tables of docs/studies.md, from the tables that the studies have written.

    python3 demos/studies/figures.py [FOLDER]

Draws into FOLDER, results/figures by default, and prints the tables as Markdown.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from convergence import read_table
from rates import Curve, Panel, rate_plot

from contact_locking.view.report.folders import Row

RESULTS = Path("results")
MEASURED = "certificate.errors.penalty_measured.displacement_norm"
IN_V = r"$\|u_n - u\|_V$"
THEOREM_4_9 = {
    "block, 2D": "theorem_4_9",
    "block, 3D": "theorem_4_9_3d",
    "2D, μ of the slip": "theorem_4_9_slip",
}
BOUNDED = {
    "displacement_norm": r"$\|u_n\|_V$",
    "locking_penalty": r"$2n \int ([|\varepsilon| - M]^+)^2$",
    "contact_penalty": r"$n \int ([u_\nu]^+)^2$",
    "locking_work": r"$\int M |Z|$",
}
PENALTIES = (10.0, 1e2, 1e3, 1e4, 1e5, 1e6)
# Rates are fitted to the last values, where they have settled.
FITTED = 3


def rows(name: str, **where: Any) -> list[Row]:
    """The rows of a study whose keys (dots as ``__``) have the given values."""
    wanted = {key.replace("__", "."): value for key, value in where.items()}
    return [row for row in read_table(RESULTS / name) if wanted.items() <= row.items()]


def curve(label: str, found: Sequence[Row], x: str, y: str, fitted: int = 0) -> Curve:
    return Curve(label, [row[x] for row in found], [row[y] for row in found], fitted)


def theorem_4_9() -> list[Panel]:
    curves = []
    for label, name in THEOREM_4_9.items():
        found = rows(name)
        settled = sum(row["penalty.n"] >= 1e3 for row in found)
        curves.append(curve(label, found, "penalty.n", MEASURED, settled))
    values = [dict(zip(c.x, c.y, strict=True)) for c in curves]
    body = [[f"{n:.0e}", *(f"{value[n]:.2e}" for value in values)] for n in PENALTIES]
    body.append(["rate, n ≥ 1e3", *(f"{c.rate:.2f}" for c in curves)])
    table(["n = 1/ε", *THEOREM_4_9], body)
    return [Panel("Theorem 4.9: rates from n = 1e3 on", "n = 1/ε", IN_V, curves)]


def bounds() -> list[Panel]:
    found = rows("theorem_4_9")
    panels = []
    for name, title in BOUNDED.items():
        fitted = FITTED if name.endswith("penalty") else 0
        value = curve("value", found, "penalty.n", f"bounds.{name}.value", fitted)
        bound = curve("bound", found, "penalty.n", f"bounds.{name}.bound")
        panels.append(Panel(title, "n = 1/ε", "", [value, replace(bound, plain=True)]))
    body = [
        [f"{row['penalty.n']:.0e}", *(f"{row[f'bounds.{name}.value']:.2e}" for name in BOUNDED)]
        for row in found
        if row["penalty.n"] in PENALTIES
    ]
    body.append(["bound", *(f"{found[0][f'bounds.{name}.bound']:.2e}" for name in BOUNDED)])
    table(["n = 1/ε", *(name.replace("_", " ") for name in BOUNDED)], body)
    return panels


def separate_penalties() -> list[Panel]:
    panels, body = [], []
    for symbol, key, title in (
        ("n", "penalty.n", r"n alone, $\epsilon = 10^{-12}$"),
        ("ε", "penalty.epsilon", r"$\epsilon$ alone, $n = \infty$"),
    ):
        curves = []
        for h in (0.0625, 0.0078125):
            for mu in (0.3, 0):
                cases = rows("separate_penalties", mesh__h=h, friction__coefficient=mu)
                found = [row for row in cases if (row["penalty.n"] == "inf") == (symbol == "ε")]
                label = f"h = 1/{1 / h:.0f}, μ = {mu}"
                curves.append(curve(label, found, key, MEASURED, FITTED))
                rate = f"{curves[-1].rate:.2f}"
                body.append([f"{symbol}, {label}", *(f"{y:.2e}" for y in curves[-1].y), rate])
        panels.append(Panel(title, symbol, "distance to u in V", curves))
    table(["", *(f"n = 1e{k}, ε = 1e-{k}" for k in range(1, 7)), "rate"], body)
    return panels


def theorem_4_10() -> list[Panel]:
    found = rows("theorem_4_10")
    couplings = list(dict.fromkeys(row["coupling"] for row in found))
    in_h, in_n, body = [], [], []
    for coupling in couplings:
        mine = [row for row in found if row["coupling"] == coupling]
        h, n = [row["h"] for row in mine], [row["n"] for row in mine]
        error = [row["relative"]["v"] for row in mine]
        label = re.sub(r"n\^(-[\d.]+)", r"$n^{\1}$", coupling)
        label = label.replace("inf", "∞").replace("eps", "ε")
        in_h.append(Curve(label, h, error, FITTED))
        rate_in_n = ""
        if n[0] != "inf":
            in_n.append(Curve(label, n, error, FITTED))
            rate_in_n = f"{in_n[-1].rate:.2f}"
        last = f"{n[-1]:.4g}" if n[0] != "inf" else "∞"
        values = [f"{value:.2e}" for value in error]
        body.append([coupling, last, *values, f"{in_h[-1].rate:.2f}", rate_in_n])
    sizes = [f"1/{1 / row['h']:.0f}" for row in found if row["coupling"] == couplings[0]]
    table(["", "last n", *sizes, "rate in h", "rate in n"], body)
    words = r"$\|u_n^h - u\|_V \,/\, \|u\|_V$"
    return [
        Panel("Theorem 4.10: rates in h", "h", words, in_h),
        Panel("the same over n", "n = 1/ε", words, in_n),
    ]


def local_friction() -> list[Panel]:
    panels, body = [], []
    for key, title in (
        ("v", r"$\|u_r - u_0\|_V$"),
        ("contact", r"$|u_r - u_0|$ in $L^2(\Gamma_C)$"),
    ):
        curves = []
        for kernel in ("convolution", "helmholtz"):
            found = rows("local_friction", kernel=kernel)
            r, errors = [row["r"] for row in found], [row["error"][key] for row in found]
            curves.append(Curve(kernel, r, errors, len(r)))
            values = [f"{error:.2e}" for error in errors]
            body.append([f"{kernel}, {key}", *values, f"{curves[-1].rate:.2f}"])
        panels.append(Panel(title, "r", "", curves))
    table(["", *(f"r = {x:g}" for x in panels[0].curves[0].x), "rate"], body)
    return panels


def locking_stress() -> list[Panel]:
    found = rows("locking_stress")
    halvings = [math.log2(1.0 / row["h"]) for row in found]
    heads = {"l1": r"$\int |Z|$", "l2_squared": r"$\int |Z|^2$"}
    panels = [
        Panel(
            title,
            r"$\log_2(1/h)$",
            "",
            [Curve("n = ∞", halvings, [row[key] for row in found])],
            logarithmic=False,
        )
        for key, title in heads.items()
    ]
    panels.append(Panel(r"$\max |Z|$", "h", "", [curve("n = ∞", found, "h", "max", FITTED)]))
    body = [
        [f"1/{1.0 / row['h']:.0f}", *(f"{row[key]:.3e}" for key in ("l1", "l2_squared", "max"))]
        for row in found
    ]
    table(["h", "∫ \\|Z\\|", "∫ \\|Z\\|²", "max \\|Z\\|"], body)
    return panels


def error_bound() -> list[Panel]:
    panels, body = [], []
    found = rows("error_bound_measured")
    sizes = [f"h = 1/{1.0 / h:.0f}" for h in dict.fromkeys(row["mesh.h"] for row in found)]
    for degree in (1, 2):
        curves = []
        for limit in ("inf", 0.05, 0.02):
            for n, text in ((1e4, "1e4"), ("inf", "∞")):
                keys = ("discretisation.degree", "material.locking_limit", "penalty.n")
                case = [row for row in found if [row[key] for key in keys] == [degree, limit, n]]
                cells = [f"{r['bound']:.3f}, {r['estimate']:.3f}, {r['error']:.3f}" for r in case]
                ratio = f"{case[-1]['bound'] / case[-1]['error']:.1f}"
                body.append([str(degree), str(limit).replace("inf", "∞"), text, *cells, ratio])
                if limit == 0.02:
                    curves.append(curve(f"bound, n = {text}", case, "mesh.h", "bound"))
        curves += [curve(f"{name}, n = ∞", case, "mesh.h", name) for name in ("error", "estimate")]
        panels.append(Panel(f"degree {degree}, M = 0.02", "h", "", curves))
    table(["degree", "M", "n", *sizes, "bound / error"], body)
    return panels


def contraction() -> list[Panel]:
    mu, factor = "friction.coefficient", "friction_fixed_point.contraction"
    paper, inside = (rows("contraction", solver__method=m) for m in ("penalty", "interior_point"))
    line = Curve("1", [paper[0][mu], paper[-1][mu]], [1.0, 1.0], plain=True)
    factors = [curve("factor", paper, mu, factor), line]
    steps = [
        curve(method, [row for row in cases if row["converged"]], mu, "iterations.tangents")
        for method, cases in (("penalty", paper), ("interior_point", inside))
    ]
    body = [
        [f"{a[mu]:g}", f"{a[factor]:.3f}", _steps(a), _steps(b)]
        for a, b in zip(paper, inside, strict=True)
    ]
    table(["μ", "contraction factor", "tangents, penalty", "tangents, interior_point"], body)
    return [
        Panel("Contraction of the friction bound's map", "μ", "", factors, logarithmic=False),
        Panel("Tangents where it converged", "μ", "", steps, logarithmic=False),
    ]


def lost_equilibrium() -> list[Panel]:
    mu, force = "friction.coefficient", "contact_force.1"
    found = rows("lost_equilibrium")
    solved = [row for row in found if row["converged"]]
    squares = [row[force] ** -2 for row in solved]
    inverse = Curve("h = 1/4", [row[mu] for row in solved], squares)
    body = [
        [f"{row[mu]:g}", f"{row[force]:.4f}" if row["converged"] else "", _steps(row)]
        for row in found
    ]
    table(["μ", "contact force", "tangents"], body)
    return [
        Panel("Contact force", "μ", "", [curve("h = 1/4", solved, mu, force)], logarithmic=False),
        Panel("1 / contact force²", "μ", "", [inverse], logarithmic=False),
    ]


def _steps(row: Row) -> str:
    return str(row["iterations.tangents"]) if row["converged"] else "not converged"


def table(head: Sequence[str], body: Sequence[Sequence[str]]) -> None:
    for line in (head, ["---"] * len(head), *body):
        print("| " + " | ".join(line) + " |")
    print()


FIGURES: dict[str, Callable[[], list[Panel]]] = {
    "theorem_4_9": theorem_4_9,
    "bounds": bounds,
    "separate_penalties": separate_penalties,
    "theorem_4_10": theorem_4_10,
    "local_friction": local_friction,
    "contraction": contraction,
    "lost_equilibrium": lost_equilibrium,
    "locking_stress": locking_stress,
    "error_bound": error_bound,
}


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    for name, panels in FIGURES.items():
        rate_plot(panels(), folder / f"{name}.svg")


if __name__ == "__main__":
    main()
