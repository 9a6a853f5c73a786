"""Multigrid for an elastic matrix: algebraic, and above it the spaces that the elements have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from petsc4py import PETSc

from contact_locking.solver.linear.ksp import configure, multigrid_options, option
from contact_locking.solver.linear.options import PREFIX

_PREFIX = PREFIX + "multigrid_"
# The zones move but the mesh does not: only values are made anew.
_ALGEBRAIC: dict[str, Any] = {"pc_gamg_reuse_interpolation": True}
# Relaxation sees the matrix in blocks, Galerkin products its copy without them.
_FINEST: dict[str, Any] = {"pc_use_amat": True}
_COARSE = "mg_coarse_"
_SMOOTHER_STEPS = "mg_levels_ksp_max_it"
_WITH_LEVELS = PETSc.PC.Type.GAMG, PETSc.PC.Type.MG


class CoarserSpace(NamedTuple):
    """A part of the space, with the prolongation from it, and the rigid motions in it.

    Algebraic coarsening of quadratic elements takes twice the iterations of that of affine ones,
    as midpoints of edges and corners are nodes of different kinds.
    """

    prolongation: PETSc.Mat
    near_nullspace: PETSc.NullSpace


class Multigrid:
    """One cycle for the values of a matrix; all of it is collective.

    ``coarser`` is the space below the matrix's own, if there is one: relaxation on the finest
    level, and algebraic multigrid for the Galerkin product below.  Without it, or where the user
    wants another preconditioner, PETSc coarsens the matrix itself.  ``overrides`` are options of
    the user.
    """

    def __init__(
        self, comm: Any, coarser: Sequence[CoarserSpace], overrides: Mapping[str, Any]
    ) -> None:
        self._pc = PETSc.PC().create(comm)
        self._coarser = list(coarser)
        self._product: PETSc.Mat | None = None
        algebraic = multigrid_options() | _ALGEBRAIC
        options = algebraic | _FINEST
        if self._coarser:
            below = {_COARSE + name: value for name, value in algebraic.items()}
            above = {name: algebraic[name] for name in algebraic if name.startswith("mg_levels_")}
            options = {"pc_type": "mg", _COARSE + "ksp_type": "preonly"} | below | above | _FINEST
        self._more_steps = 2 * algebraic[_SMOOTHER_STEPS]
        is_free = option(_SMOOTHER_STEPS, {}, overrides, _PREFIX) is None
        self._options = configure([self._pc], options, overrides, _PREFIX)
        self._may_smooth_more = is_free and self._pc.getType() in _WITH_LEVELS
        if self._pc.getType() != PETSc.PC.Type.MG:
            self._coarser = []
        # The levels take the prefix that the options have by now.
        for space in self._coarser:
            self._pc.setMGLevels(2)
            self._pc.setMGInterpolation(1, space.prolongation)

    def set_up(self, matrix: PETSc.Mat, by_entry: PETSc.Mat) -> None:
        """Take the present values of a matrix in blocks and of its copy ``by_entry``."""
        self._pc.setOperators(matrix, by_entry)
        for prolongation, near_nullspace in self._coarser:
            if self._product is None:
                self._product = by_entry.ptap(prolongation)
                self._product.setNearNullSpace(near_nullspace)
            else:
                by_entry.ptap(prolongation, self._product)
            # PETSc forgets it with each new value.
            self._product.setOption(PETSc.Mat.Option.SPD, True)
            self._pc.getMGCoarseSolve().setOperators(self._product)
        self._pc.setUp()

    def smooth_more(self) -> None:
        """Take twice the steps of the smoother, unless the user has chosen their number.

        In the spaces above algebraic multigrid, if there are any, and else on all its levels.  To
        be called after each set-up.
        """
        if self._may_smooth_more:
            for level in range(1, self._pc.getMGLevels()):
                self._pc.getMGSmoother(level).setTolerances(max_it=self._more_steps)

    def apply(self, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """``z = G r``."""
        self._pc.apply(r, z)

    def destroy(self) -> None:
        """Free the PETSc objects but those of ``coarser``."""
        self._options.remove()
        self._pc.destroy()
        if self._product is not None:
            self._product.destroy()
