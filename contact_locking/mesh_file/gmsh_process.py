"""The program that reads a mesh file with Gmsh: arguments are the file, the result, and its name.

Its exit code is that of InputError, with the message as output, for what a mesh may not be.
"""

from __future__ import annotations

import sys
from pathlib import Path

from contact_locking.errors import InputError
from contact_locking.mesh_file.gmsh_model import extract
from contact_locking.meshes import empty_model


def main(source: str, target: str, origin: str) -> int:
    """Read ``source`` and save its arrays as ``target``."""
    import gmsh

    try:
        with empty_model() as model:
            try:
                gmsh.merge(source)
            except Exception as error:  # Gmsh's own errors have no type of their own
                said = str(error).replace(source, origin)
                raise InputError(f"Gmsh cannot read {origin}: {said}") from error
            extract(model, origin).save(Path(target))
    except InputError as error:
        sys.stdout.buffer.write(str(error).encode("utf-8", errors="backslashreplace"))
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
