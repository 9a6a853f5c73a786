"""The forms of the elastic body for any displacement, which a problem compiles once."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.fem import compiled
from contact_locking.fem.joint_forms import JointForm
from contact_locking.laws.convex import squared_norm
from contact_locking.problem import forms


class BodyForms:
    """``a(w, w)/2``, ``a(w, .)``, ``|eps(w)|`` and ``(f, .)`` of displacements w; collective.

    Nodal forces are local arrays of the displacement space, ghosts included.
    """

    def __init__(self, space: fem.FunctionSpace, data: forms.ProblemData) -> None:
        v, self._data = ufl.TestFunction(space), data
        self._w, self._forces = fem.Function(space), fem.Function(space)
        # Cells and facets have forms of their own, as those of `JointForm`.
        parts = [data.elasticity, *(item.form for item in data.springs)]
        self._energies = [compiled.form(0.5 * part(self._w, self._w)) for part in parts]
        self._elastic = JointForm(forms.elastic_form(self._w, v, data))
        self._external = JointForm(forms.external_work(v, data))
        self._comm = space.mesh.comm

    def energy(self, w: fem.Function) -> float:
        """``a(w, w)/2``."""
        return sum(self._value(energy, w) for energy in self._energies)

    def strain_norm(self, w: fem.Function) -> float:
        """``|w|_V = |eps(w)|`` in L2 (10)."""
        return float(np.sqrt(self._value(self._square, w)))

    def elastic_forces(self, w: fem.Function) -> FloatArray:
        """``a(w, .)``."""
        self._w.x.array[:] = w.x.array
        return self._nodal(self._elastic)

    def loads(self) -> FloatArray:
        """``(f, .)`` at the present time."""
        return self._nodal(self._external)

    def eigenstrain_work(self, w: fem.Function) -> float:
        """``-(A eps_0, eps(w))``, 0 without an eigenstrain."""
        return 0.0 if self._data.eigenstrain is None else self._value(self._initial, w)

    def eigenstrain_forces(self) -> FloatArray:
        """``-(A eps_0, eps(.))``, zeros without an eigenstrain."""
        if self._data.eigenstrain is None:
            return np.zeros_like(self._w.x.array)
        return self._nodal(self._eigen_forces)

    def eigenstrain_energy(self) -> float:
        """``(A eps_0, eps_0)/2``, 0 without an eigenstrain."""
        if self._data.eigenstrain is None:
            return 0.0
        return float(self._comm.allreduce(fem.assemble_scalar(self._eigen)))

    @cached_property
    def _initial(self) -> fem.Form:
        return compiled.form(forms.initial_work(self._w, self._data))

    @cached_property
    def _eigen_forces(self) -> JointForm:
        test = ufl.TestFunction(self._w.function_space)
        return JointForm(forms.initial_work(test, self._data))

    @cached_property
    def _eigen(self) -> fem.Form:
        return compiled.form(forms.initial_energy(self._data))

    @cached_property
    def _square(self) -> fem.Form:
        data = self._data
        eps = data.strain(self._w)
        return compiled.form(squared_norm(eps) * data.element.elastic_dx(data.dx))

    def _value(self, form: fem.Form, w: fem.Function) -> float:
        self._w.x.array[:] = w.x.array
        return float(self._comm.allreduce(fem.assemble_scalar(form)))

    def _nodal(self, form: JointForm) -> FloatArray:
        form.assemble_vector(self._forces.x)
        self._forces.x.scatter_forward()
        return self._forces.x.array.copy()
