"""The mesh of a solution with some of its cells refined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from contact_locking.arrays import BoolArray
from contact_locking.contact.coulomb import default_radius
from contact_locking.errors import NotRefined
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.whole_mesh import WholeMesh, gather_mesh, spread
from contact_locking.parallel import on_root
from contact_locking.process.adaptivity import refinement
from contact_locking.results.solution import StudySolution

_STRAIGHT = (
    "the mesh is so coarse that the refinement keeps the facets of curved sides straight; make "
    "mesh.h smaller for curves"
)


def finer_mesh(
    solution: StudySolution,
    marks: Callable[[WholeMesh], BoolArray],
    most: int,
    name: str,
    may_stay_straight: bool = False,
    is_nested: bool = False,
) -> Domain:
    """The mesh of a solution with the cells ``marks`` (k,) refined; collective.

    ``marks`` is called on rank 0.  ``most`` is the largest number of unknowns, and ``name`` its
    name in words.  Default radii of smoothing stay those of the first mesh.  Curved sides of a
    builder stay curved, unless the mesh ``is_nested`` in that of the solution.  Where a cell would
    collapse at a curved side, the sides keep the facets of the mesh if they ``may_stay_straight``,
    with a warning.  Raises NotRefined, on all ranks.
    """
    domain, geometry = solution.domain, solution.parameters.mesh.geometry
    mesh, radii = gather_mesh(domain), smoothing_radii(solution)
    held: list[WholeMesh] = []

    def work() -> None:
        assert mesh is not None
        told = mesh.warnings
        curved = () if geometry is None or is_nested else geometry.curved
        marked, news = marks(mesh), list[str]()
        try:
            finer = refinement.refined(mesh, marked, curved)
        except refinement.Collapses:
            if not may_stay_straight:
                raise
            finer, news = refinement.refined(mesh, marked), [_STRAIGHT]
        news += refinement.warnings(mesh.data) if geometry is None else []
        news = [text for text in news if text not in told]
        held.append(replace(finer, warnings=(*told, *news), smoothing_radii=radii))

    on_root(domain.comm, work)
    finer = spread(held[0] if held else None, domain.comm)
    dofmap = solution.element.displacement_space(finer.mesh).dofmap
    dofs = int(dofmap.index_map.size_global * dofmap.index_map_bs)
    if dofs > most:
        raise NotRefined(f"the next mesh has {dofs} unknowns, more than {name}")
    return finer


def smoothing_radii(solution: StudySolution) -> dict[str, float]:
    """The default smoothing radii of the contacts on the first mesh, by their keys; collective."""
    return solution.domain.smoothing_radii or {
        one.contact.key: default_radius(one.surface) for one in solution.contacts
    }
