"""Linear algebra over PETSc: Krylov solvers and their options, multigrid, factorisations."""
