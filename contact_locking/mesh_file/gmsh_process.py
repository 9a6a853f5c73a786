"""The program that reads a mesh file with Gmsh.

The arguments are the file, the file for the arrays, the name of the mesh for messages, and what is
read: the ``body``, or the ``triangles`` of a surface.  For an
InputError the program prints the message and ends with the exit code of InputError.
"""

from __future__ import annotations

import os
import resource
import sys
from pathlib import Path

import numpy as np

from contact_locking.errors import InputError
from contact_locking.mesh_file.gmsh_model import extract, triangles
from contact_locking.meshes import empty_model

# No mesh takes Gmsh so many seconds of the processor.
_LONGEST = 3600


def limit_process() -> None:
    """Let this process have the memory of the machine, and an hour of its processor, at most."""
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, _LONGEST)):
        soft, hard = resource.getrlimit(kind)
        limits = [limit for limit in (most, soft, hard) if limit != resource.RLIM_INFINITY]
        resource.setrlimit(kind, (min(limits), hard))


def main(source: str, target: str, origin: str, what: str) -> int:
    """Read the mesh in ``source`` and save its arrays in ``target``."""
    import gmsh

    try:
        with empty_model() as model:
            try:
                gmsh.merge(source)
            except Exception as error:  # Gmsh raises Exception itself
                said = str(error).replace(source, origin)
                raise InputError(f"Gmsh cannot read {origin}: {said}") from error
            if what == "triangles":
                np.savez(target, corners=triangles(model, origin))
            else:
                extract(model, origin).save(Path(target))
    except InputError as error:
        sys.stdout.buffer.write(str(error).encode("utf-8", errors="backslashreplace"))
        return error.exit_code
    return 0


if __name__ == "__main__":
    limit_process()
    sys.exit(main(*sys.argv[1:]))
