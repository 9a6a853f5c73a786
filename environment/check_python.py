"""Exit 0 if this Python can run contact_locking.

Imports nothing heavy, as ./in-env asks every time.
"""

import sys
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec

OLDEST_DOLFINX = (0, 9)
NEEDED = (
    *("petsc4py", "mpi4py", "gmsh", "numpy", "scipy"),
    *("pydantic", "ruamel.yaml", "h5py", "jinja2", "matplotlib"),
)


def is_importable(name: str) -> bool:
    """Whether there is such a module, dotted names too."""
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # the parent of a dotted name
        return False


def main() -> int:
    """Print nothing where DOLFINx itself is missing: ./in-env has another way then."""
    try:
        dolfinx = version("fenics-dolfinx")
    except PackageNotFoundError:
        return 1
    if tuple(int(part) for part in dolfinx.split(".")[:2]) < OLDEST_DOLFINX:
        return 1
    missing = [name for name in NEEDED if not is_importable(name)]
    if missing:
        print(
            f"in-env: {sys.executable} has DOLFINx {dolfinx} but lacks {', '.join(missing)};"
            " with them it would be used as it is",
            file=sys.stderr,
        )
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
