"""Findings about data, solves and results that are probably not intended, with their texts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: The texts by code.  A text about a key begins with it.
TEXTS = {
    "mesh.second_order": "has second-order cells, of which only the corners are used: sides are "
    "straight",
    "mesh.other_elements": "has elements of other kinds, which are ignored: {elements}",
    "mesh.empty_sets": "these sets have no facet on the boundary: {names}",
    "mesh.thin_cells": "{count} cells are nearly collapsed, such as {cell}: a {kind} as thin as "
    "this makes results inaccurate",
    "mesh.cut": "the body is cut along duplicate nodes: {nodes}; unless this is intended, {advice}",
    "mesh.group_off_boundary": "{text}; they are ignored",
    "data.features": "changes from {low:.3g} to {high:.3g} inside a {entity} near {place}, where "
    "it is evaluated at a few points only; {advice}",
    "smoothing.radius": "{radius:g} is not larger than the mesh size {size:.3g} on {on}, so R "
    "hardly smooths; refine the mesh there or increase the radius",
    "foundation.degenerate": "{file}: {count} degenerate triangles are ignored",
    "foundation.copies": "{file}: {count} duplicate triangles are ignored",
    "foundation.open": "{file}: the surface is open: {count} edges belong to one triangle only; "
    "the tool is behind the triangles, and the body must not reach around the rim",
    "foundation.double_corners": "{count} corners are repeated",
    "foundation.turned": "the outline is in the order of a die around the body, but the body is "
    "not in the hole; the other side is used: {advice}",
    "foundation.right_angles": "the surface of the foundation is perpendicular to Gamma_C "
    "everywhere, so that it cannot press; turn it, or name a boundary part that faces the "
    "foundation",
    "foundation.gradient": "the length of its gradient is between {low:.3g} and {high:.3g} on "
    "Gamma_C, and not 1 as for a distance; the expression is divided by this length, which gives "
    "the distance near its zeros only",
    "foundation.end": "a part of Gamma_C lies beyond the end of the open foundation, whose rim is "
    "nearest there; let the foundation reach beyond the body",
    "gap.inside": "all of the body is inside the foundation, Gamma_C at least {depth:.3g} deep; "
    "check the position of the foundation, and the sign of the gap, which is positive outside",
    "foundation.overlap": "overlaps the body at rest by up to {depth:.3g}, along normals that vary "
    "by up to {turn:.2g} rad, and friction depends on how it got there: let it touch first, and "
    "use {key}.motion and steps",
    "foundation.far": "the body is {extent:.3g} long, and the foundation is {distance:.3g} away "
    "from Gamma_C; check its position, and that its units are those of the mesh",
    "foundation.size": "is {size:.3g} long, and the body {extent:.3g}; check that its units are "
    "those of the mesh",
    "load.zero": "is zero at all quadrature points; check where the load acts, and that this is "
    "not smaller than the elements",
    "load.sharp": "changes too sharply for this mesh near {place}, where it reaches {size:.3g}; "
    "its resultant is uncertain by about {per_cent:.2g} %{nodes}: refine the mesh there, or "
    "distribute the load more widely",
    "load.large": "reaches {ratio:.3g} times the stiffness of the material; check that their units "
    "agree",
    "strain.large": "the largest strain is {strain:.3g}, and this theory is for small strains: "
    "stresses there are uncertain by about {per_cent:.0f} %",
    "strain.absurd": "the largest strain is {strain:.3g}, and this theory is for small strains: "
    "check that the units of loads, elasticity and lengths agree, and that displacement conditions "
    "or contact hold the body",
    "rotation.large": "the body rotates by {angle:.2g} rad near ({place}), and this theory is for "
    "small rotations: it neglects strains of {neglected:.2g}, half of the square, while the "
    "largest strain is {strain:.2g}; use a smaller load, or a program for large rotations",
    "limit.exceeded": "the strain exceeds its limit by up to {per_cent:.0f} %: penalty.n: {n:.1e} "
    "reduces this to about {aim:.0f} %, and .inf removes it, or reports that no displacement on "
    "this mesh within the limit has the prescribed values",
    "limit.exceeded_far": "the strain is up to {times:.3g} times its limit: penalty.n: {n:.1e} "
    "reduces the excess to about {aim:.0f} %, and .inf removes it, or reports that no displacement "
    "on this mesh within the limit has the prescribed values",
    "limit.between_points": "the strain is up to {per_cent:.0f} % of its limit between the points "
    "of a cell where the element enforces it; a finer mesh brings this nearer to 100 %",
    "steps.halved": "the step to t = {time:.6g} {failure}; it is halved",
    "steps.ended": "the process ends at t = {time:.6g} ({reason})",
    "steps.restart": "the state at t = {time:.6g}, from which the process restarts, is not an "
    "equilibrium for the present data; the energy balance of the next step is not checked",
    "contact.coarser": "the facets of {on} are {ratio:.2g} times as long as those of {against}, "
    "and the conditions of contact hold only at the nodes of on; let the finer side be on: "
    "{{on: {against}, against: {on}}}",
    "contact.held_nodes": "the foundation enters the body by {depth:.3g} at nodes whose "
    "displacement is prescribed, where contact does not act; end contact.on, or the foundation, "
    "before that part",
    "contact.between_nodes": "between the nodes near ({place}) the foundation enters the body by "
    "{depth:.3g}, {per_cent:.0f} % of its indentation; the conditions of contact hold only at the "
    "nodes: use smaller cells there, or a rounder foundation",
    "contact.uncovered": "the boundary outside of {key}.on enters the foundation by {depth:.3g} "
    "near ({place}), where contact does not act; add that boundary part to {key}.on, unless the "
    "foundation ends before it",
    "contact.normals": "the normals of the bodies where they press differ by {turn:.2g} rad from "
    "those of the undeformed mesh, which matters for a friction coefficient of {friction:.3g}; "
    "leave out pair: once",
    "contact.sliding": "the bodies slide by {slid:.3g} along each other, {facets:.2g} facets of "
    "against, but are paired as in the undeformed mesh: leave out pair: once",
    "contact.unsettled": "the pairing of the bodies still changes after {solves} solves: normals "
    "and gaps are accurate to some per cent; use smaller steps, or support the bodies better",
    "solver.unused_options": "PETSc has not used these options: {names} (solver.petsc, or after "
    "--)",
    "kappa.constants": "displacements are prescribed at Gamma_C, as at {place}, and R preserves "
    "constants there, so that kappa grows without bound as the mesh is refined",
    "output.left_out": "{reason}",
    "adapt.stopped": "adapt.tolerance was not reached: {reason}",
    "contact.penetration": "the body enters the foundation by {per_cent:.0f} % of its largest "
    "displacement: {parameter}: {value:.1e} reduces this to about {aim:.0f} %, and penalty.n: .inf "
    "without penalty.epsilon removes it",
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
