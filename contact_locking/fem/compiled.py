"""UFL forms and expressions, compiled by DOLFINx into a folder of this package's own."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Hashable, Iterator
from typing import Any, TypeVar

import dolfinx
import ffcx
from dolfinx import fem, jit

from contact_locking import _compat
from contact_locking.arrays import FloatArray
from contact_locking.errors import ContactLockingError
from contact_locking.mesh.domain import Domain

T = TypeVar("T")

# How long to wait for a form that another process compiles: the longest compilation, of the
# tangent of Newton's method in 3D, takes some ten seconds on a busy machine.
_TIMEOUT = 60


def form(integrals: Any) -> fem.Form:
    """The compiled form of a UFL form; collective."""
    with _explained():
        return fem.form(integrals, jit_options=options())


def integral(domain: Domain, integrals: Any) -> float:
    """The value of a functional; collective."""
    return float(domain.comm.allreduce(fem.assemble_scalar(form(integrals))))


def expression(value: Any, points: FloatArray, comm: Any = None) -> fem.Expression:
    """The compiled UFL expression at points (k, d) of the reference cell; collective.

    ``comm`` are the ranks of an expression of numbers alone, which has no mesh.
    """
    with _explained():
        return fem.Expression(value, points, comm=comm, jit_options=options())


def interpolation(value: Any, space: fem.FunctionSpace) -> fem.Expression:
    """The compiled UFL expression that DOLFINx interpolates into ``space``; collective."""
    return expression(value, _compat.interpolation_points(space), space.mesh.comm)


def options() -> dict[str, Any]:
    """DOLFINx's ``jit_options``: a folder of this package's own in its cache, and a timeout.

    The user's ``dolfinx_jit_options.json`` gives the compiler's options, the place of the cache,
    and a longer timeout.
    """
    given = jit.get_options()
    versions = f"dolfinx-{dolfinx.__version__}-ffcx-{ffcx.__version__}"
    folder = given["cache_dir"] / f"contact-locking-{versions}"
    return {"cache_dir": folder, "timeout": max(_TIMEOUT, given["timeout"])}


class Kept:
    """Compiled forms and evaluated data of one problem, by names, for its next solve."""

    def __init__(self) -> None:
        self._found: dict[Hashable, Any] = {}

    def __call__(self, name: Hashable, make: Callable[[], T]) -> T:
        """The result of the first call of :func:`make` with the name; collective if that is."""
        if name not in self._found:
            self._found[name] = make()
        found: T = self._found[name]
        return found


@contextlib.contextmanager
def _explained() -> Iterator[None]:
    """Say what to do where a form that another process began to compile is not ready in time.

    FFCx writes the C file of a form before the compilation and a second file afterwards, for which
    others wait.  A process that is killed in between leaves the C file alone.
    """
    try:
        yield
    except (TimeoutError, RuntimeError) as error:
        # With several ranks DOLFINx raises RuntimeError, with the text on the first rank.
        if "timed out" not in str(error):
            raise
        named = re.search(r"\S+\.c\b", str(error))
        file = named[0] if named else f"the youngest .c file in {options()['cache_dir']}"
        raise ContactLockingError(
            f"another process began to compile a form, which is not ready after "
            f"{options()['timeout']} s. Wait until that process is done; if it was interrupted, "
            f"delete {file} and start again"
        ) from error
