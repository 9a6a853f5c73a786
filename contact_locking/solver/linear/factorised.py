"""The sizes up to which linear systems are factorised: of the solver, and of the estimate."""

from __future__ import annotations

# Above these many unknowns, by dimension, GMRES takes over; below, the direct solver is as fast or
# nearly so, and it never fails.  In 3D they are even at 25 000, and at 110 000 GMRES takes half the
# time.
DIRECT_LIMIT = {2: 1_000_000, 3: 50_000}
# So many unknowns are filtered at most, by dimension and degree of the elements.  With linear
# elements in 3D a filter of 70 000 unknowns takes as long as the projection, and with 130 000 it
# takes longer.  With quadratic elements the projection takes several times as long as the filter;
# beyond this limit the filter's memory would be that of the whole solve again.
FILTER_LIMIT = {(2, 1): 1_000_000, (2, 2): 1_000_000, (3, 1): 100_000, (3, 2): 300_000}
# Multigrid alone copes with cells that are so many times as stiff as the material, if it is allowed
# more iterations.
MODERATE_CONTRAST = 1e5


def chosen(linear: str, dim: int, size: int) -> str:
    """The name that ``linear`` stands for: auto is direct or iterative, by dimension and size.

    ``size`` are the unknowns of a cube that takes as long to factorise.
    """
    if linear != "auto":
        return linear
    return "direct" if size <= DIRECT_LIMIT[dim] else "iterative"
