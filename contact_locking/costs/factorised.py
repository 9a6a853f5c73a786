"""The sizes up to which linear systems are factorised: of the solver, and of the estimate."""

from __future__ import annotations

# Above these many unknowns, by dimension, GMRES takes over; below, the direct solver is as fast or
# nearly so, and it never fails.  In 3D they are even at 25 000, and at 110 000 GMRES takes half the
# time.
DIRECT_LIMIT = {2: 1_000_000, 3: 50_000}
# What is factorised beside GMRES may be larger: without it GMRES takes very long.  With 225 000
# unknowns filtered in 3D a solve takes half the time that it takes with the projection, and 2 GB
# more; with twice as many the memory would be that of the whole solve again.
FILTER_LIMIT = {2: 1_000_000, 3: 300_000}
# Multigrid alone copes with cells that are so many times as stiff as the material, if it is allowed
# more iterations.
MODERATE_CONTRAST = 1e5


def chosen(linear: str, dim: int, size: int) -> str:
    """The name that ``linear`` stands for: auto is direct or iterative, by dimension and size."""
    if linear != "auto":
        return linear
    return "direct" if size <= DIRECT_LIMIT[dim] else "iterative"
