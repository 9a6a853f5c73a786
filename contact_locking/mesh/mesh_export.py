"""A mesh with its groups as an XDMF file, which all ranks can read together."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
from dolfinx import io
from dolfinx import mesh as dmesh

from contact_locking.errors import InputError, explained
from contact_locking.files.atomic import staging
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.file.xdmf_grids import data_file
from contact_locking.parallel import on_root

T = TypeVar("T")

_MESH = "mesh"
# These characters end names in XML, in XPath or in HDF5.
_FORBIDDEN = frozenset("/'\"<>&")


def export(domain: Domain, path: Path) -> None:
    """Write a mesh and its groups as a file that `from_xdmf` reads, with its data; collective.

    The files are ``path`` and the file beside it with the ending .h5, complete or not at all.
    Raises InputError for the name of a group that XDMF files cannot have, and for files that cannot
    be written, ContactLockingError where the disk is full.
    """
    comm = domain.comm
    names = [_MESH, *domain.cell_names, *domain.facet_names]
    for name in names:
        if names.count(name) > 1 or _FORBIDDEN & set(name) or name in (".", ".."):
            raise InputError(f"a group named {name!r} cannot be written to an XDMF file")

    def explaining(work: Callable[[], T]) -> T:
        with explained(f"cannot write {path}", path):
            return work()

    with contextlib.ExitStack() as stack:
        folder = on_root(
            comm, lambda: explaining(lambda: stack.enter_context(staging(path.parent)))
        )
        try:
            _write(domain, folder / path.name)
        except RuntimeError as error:
            raise InputError(f"cannot write {path}: {error}") from error

        def put_in_place() -> None:
            for name in (data_file(path).name, path.name):
                os.replace(folder / name, path.with_name(name))

        on_root(comm, lambda: explaining(put_in_place))


def _write(domain: Domain, path: Path) -> None:
    mesh = domain.mesh
    mesh.name = _MESH
    with io.XDMFFile(domain.comm, path, "w") as file:
        file.write_mesh(mesh)
        for tags, names in (
            (domain.cell_tags, domain.cell_names),
            (domain.facet_tags, domain.facet_names),
        ):
            for name, number in names.items():
                own = tags.find(number)
                values = np.full(len(own), number, dtype=np.int32)
                group = dmesh.meshtags(mesh, tags.dim, own, values)
                group.name = name
                file.write_meshtags(group, mesh.geometry)
