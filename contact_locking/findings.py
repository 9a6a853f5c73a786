"""Findings about data, solves and results that are probably not intended, with their texts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: The texts by code.  A text about a key begins with it.
TEXTS = {
    "mesh.second_order": "its cells are of second order: their corners alone are taken, with "
    "straight sides",
    "mesh.other_elements": "its elements of other kinds are left out: {elements}",
    "mesh.empty_sets": "these sets have no facet on the boundary: {names}",
    "mesh.thin_cells": "nearly collapsed cells, {count} of them, such as {cell}: digits are lost "
    "where a {kind} is so thin",
    "mesh.cut": "the body is cut where nodes are double: {nodes}; unless it is meant to be, "
    "{advice}",
    "mesh.group_off_boundary": "{text}; they are left out",
    "data.features": "changes from {low:.3g} to {high:.3g} inside a {entity} near {place}, where "
    "the mesh sees it at few points only; {advice}",
    "smoothing.radius": "{radius:g} is not larger than the mesh size {size:.3g} on {on}, so R "
    "hardly smooths; refine the mesh there or enlarge the radius",
    "foundation.degenerate": "{file}: {count} degenerate triangles were left out",
    "foundation.copies": "{file}: {count} copies of triangles were left out",
    "foundation.open": "{file}: the surface is open, {count} edges have one triangle only; the "
    "tool is behind the triangles, and the body must not reach around the rim",
    "foundation.double_corners": "{count} corners stand twice in a row",
    "foundation.turned": "its order is that of a die around the body, which is not in the hole; "
    "the other side was taken: {advice}",
    "foundation.right_angles": "the surface of the foundation is at right angles to Gamma_C "
    "everywhere, so that it cannot press; turn it, or name a boundary part that faces the "
    "foundation",
    "foundation.gradient": "the length of its gradient is between {low:.3g} and {high:.3g} on "
    "Gamma_C, and that of a distance is 1; the expression was divided by the length, which is the "
    "distance near its zeros only",
    "foundation.end": "a part of Gamma_C lies beyond the end of the open foundation, whose rim is "
    "nearest there; let the foundation reach beyond the body",
    "gap.inside": "all of the body lies inside the foundation, Gamma_C at least {depth:.3g} deep; "
    "a gap is positive where there is a distance to the foundation: is its sign right, and the "
    "foundation in its place?",
    "foundation.overlap": "it overlaps the body at rest by up to {depth:.3g}, along normals that "
    "are up to {turn:.2g} rad off their mean, and friction does not know of the way on which it "
    "came: take {key}.motion from where it touches, and steps",
    "foundation.far": "the body is {extent:.3g} long, and the foundation is {distance:.3g} away "
    "from Gamma_C; does the foundation stand in its place, in the units of the mesh?",
    "foundation.size": "it is {size:.3g} long, and the body {extent:.3g}; are its units those of "
    "the mesh?",
    "load.zero": "is zero at all points of the quadrature; is the load meant for another place, or "
    "for a place smaller than the elements?",
    "load.sharp": "changes too sharply for this mesh near {place}, where it reaches {size:.3g}; "
    "its resultant is uncertain by about {per_cent:.2g} %{nodes}: refine the mesh there, or give a "
    "load that is wider",
    "load.large": "it reaches {ratio:.3g} times the stiffness of the material; do their units "
    "agree?",
    "strain.large": "the largest strain is {strain:.3g}, and this theory is of small strains: "
    "stresses there are uncertain by about {per_cent:.0f} %",
    "strain.absurd": "the largest strain is {strain:.3g}, and this theory is of small strains: do "
    "the units of loads, elasticity and lengths agree, and do displacement conditions or contact "
    "hold the body?",
    "rotation.large": "the body turns by {angle:.2g} rad near ({place}), and this theory is of "
    "small rotations: it neglects strains of {neglected:.2g}, half of the square, beside the "
    "largest strain of {strain:.2g}; take a smaller load, or a program for large rotations",
    "limit.exceeded": "the strain exceeds its limit by up to {per_cent:.0f} %: penalty.n: "
    "{n:.1e} leaves about {aim:.0f} %, and .inf nothing; if that hardly helps, no displacement on "
    "this mesh within the limit can follow the prescribed ones, which .inf would report",
    "limit.exceeded_far": "the strain is up to {times:.3g} times its limit: penalty.n: {n:.1e} "
    "leaves about {aim:.0f} %, and .inf nothing; if that hardly helps, no displacement on this "
    "mesh within the limit can follow the prescribed ones, which .inf would report",
    "limit.between_points": "the strain is up to {per_cent:.0f} % of its limit between the points "
    "of a cell where the element keeps the limit; a finer mesh brings this nearer to 100 %",
    "steps.halved": "the step to t = {time:.6g} {failure}; it is halved",
    "steps.ended": "the process ends at t = {time:.6g} ({reason})",
    "steps.restart": "the state at t = {time:.6g} that the process goes on from is no equilibrium "
    "with the present data; the energy balance of the next step is not judged",
    "contact.coarser": "the facets of {on} are {ratio:.2g} times as long as those of {against}, "
    "and the conditions of contact hold at the nodes of on alone; let the finer side be on: "
    "{{on: {against}, against: {on}}}",
    "contact.held_nodes": "the foundation enters the body by {depth:.3g} at nodes that "
    "loads.displacements holds, where no contact acts; end contact.on, or the foundation, before "
    "the part that is held",
    "contact.between_nodes": "between the nodes near ({place}) the foundation enters the body by "
    "{depth:.3g}, {per_cent:.0f} % of its indentation; the conditions of contact hold at the nodes "
    "alone: take smaller cells there, or a rounder foundation",
    "contact.uncovered": "the boundary outside of {key}.on enters the foundation by {depth:.3g} "
    "near ({place}), where no contact acts; add the boundary part there to {key}.on, unless the "
    "foundation ends before",
    "contact.normals": "the normals of the bodies where they press are {turn:.2g} rad off those "
    "of the undeformed mesh, which counts beside the friction coefficient {friction:.3g}; leave "
    "out pair: once",
    "contact.sliding": "the bodies slide by {slid:.3g} along each other, {facets:.2g} facets of "
    "against, and the points that face each other are those of the undeformed mesh: leave out "
    "pair: once",
    "contact.unsettled": "the place where bodies touch each other did not settle in {solves} "
    "solves: normals and gaps are known to some per cent; take smaller steps, or hold the bodies "
    "more firmly",
    "solver.factorised": "the iterative solver of solver.linear did not converge; the direct "
    "solver took its place",
    "solver.unused_options": "PETSc has not used these options: {names} (solver.petsc, or after "
    "--)",
    "kappa.constants": "displacements are prescribed at Gamma_C, as at {place}, and R keeps "
    "constants there, so that kappa grows without bound as the mesh is refined",
    "output.left_out": "{reason}",
    "adapt.stopped": "the meshes were not refined until adapt.tolerance was reached: {reason}",
    "contact.penetration": "the body enters the foundation by {per_cent:.0f} % of its largest "
    "displacement: {parameter}: {value:.1e} leaves about {aim:.0f} %, and penalty.n: .inf without "
    "an epsilon nothing",
}


class Finding(str):
    """A finding in words, with its code, the key that it is about and its numbers.

    Parameters
    ----------
    code
        a key of `TEXTS`
    key
        the key of the study file, or the argument of a script; empty for the whole body
    numbers
        what the text says
    """

    code: str
    key: str
    numbers: Mapping[str, Any]

    def __new__(cls, code: str, key: str = "", **numbers: Any) -> Finding:
        text = TEXTS[code].format(key=key, **numbers)
        finding = super().__new__(cls, f"{key}: {text}" if key else text)
        vars(finding).update(code=code, key=key, numbers=numbers)
        return finding

    def at(self, key: str) -> Finding:
        """The same finding about a key."""
        return Finding(self.code, key, **self.numbers)

    @property
    def record(self) -> list[Any]:
        """Code, key and numbers, for JSON."""
        return [self.code, self.key, self.numbers]

    def __getnewargs_ex__(self) -> tuple[tuple[str, str], dict[str, Any]]:
        return (self.code, self.key), dict(self.numbers)
