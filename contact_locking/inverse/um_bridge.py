"""A study file as a model of UM-Bridge: F(θ) = quantities at the numbers θ, and dF/dθ, by HTTP.

Programs for uncertainty and optimisation that speak the protocol of UM-Bridge
(doi:10.21105/joss.04748, JSON over HTTP, version 1.0) take such a model as a function.  θ are the
numbers `sensitivities.to` of the file, and F the quantities `sensitivities.of` after its last step.
The configuration of a request has other numbers of the file by their keys, such as `mesh.h`.
"""

from __future__ import annotations

import functools
import json
from collections import deque
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import LARGEST, FloatArray
from contact_locking.errors import ContactLockingError, InputError, NotConverged, require_kind
from contact_locking.inverse.sensitivities import value_of, with_values
from contact_locking.mesh.domain import Domain
from contact_locking.running.assembly import check
from contact_locking.running.solving import solve_steps
from contact_locking.study_file.parameters import Parameters

NAME = "forward"
# Gradients of several quantities, or along several directions, take one solve.
_KEPT = 16
_ANSWERS = ("Evaluate", "Gradient", "ApplyJacobian")


class Model:
    """The answers to requests.  Raises InputError for a study that cannot be asked for numbers."""

    def __init__(self, parameters: Parameters, comm: MPI.Intracomm) -> None:
        asked = parameters.sensitivities
        if asked is None or not asked.to:
            raise InputError(
                "names what a server takes and returns: of is the list of quantities, and to that "
                "of numbers, as parameters.mu",
                "sensitivities",
            )
        if parameters.adapt is not None:
            raise InputError("a server solves on one mesh", "adapt")
        check(parameters, comm)
        self.asked = asked.model_copy(update={"check": False})
        self._parameters, self._comm = parameters, comm
        self._domains: dict[str, Domain] = {}
        self._solved = functools.lru_cache(_KEPT)(self._solve)

    def answer(self, path: str, request: Any) -> dict[str, Any]:
        """The answer to a request.  Raises InputError for a request that is not understood."""
        if path == "/Info":
            return {"protocolVersion": 1.0, "models": [NAME]}
        require_kind(request, dict, "a JSON object", "request")
        if request.get("name") != NAME:
            raise InputError(f"the model is called {NAME}", "name")
        match path:
            case "/ModelInfo":
                return {"support": {**dict.fromkeys(_ANSWERS, True), "ApplyHessian": False}}
            case "/InputSizes":
                return {"inputSizes": [len(self.asked.to)]}
            case "/OutputSizes":
                return {"outputSizes": [len(self.asked.of)]}
            case _ if path[1:] not in _ANSWERS:
                raise InputError(f"{path[1:]} is not supported")
        of, to = len(self.asked.of), len(self.asked.to)
        vectors, config = request.get("input"), request.get("config") or {}
        if not (isinstance(vectors, list) and len(vectors) == 1):
            raise InputError("must be a list of one vector", "input")
        numbers = tuple(map(float, _vector(vectors[0], to, "input.0")))
        require_kind(config, dict, "a JSON object", "config")
        for key, value in config.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise InputError(f"{key}: a configuration has numbers only", "config")
        values, slopes = self._solved(numbers, tuple(config.items()), path != "/Evaluate")
        if path == "/Evaluate":
            return {"output": [values.tolist()]}
        if path == "/Gradient":
            return {"output": (_vector(request.get("sens"), of, "sens") @ slopes).tolist()}
        return {"output": (slopes @ _vector(request.get("vec"), to, "vec")).tolist()}

    def _solve(
        self, numbers: tuple[float, ...], config: tuple[tuple[str, float], ...], derives: bool
    ) -> tuple[FloatArray, FloatArray]:
        """The quantities (m,) and their derivatives (m, n), of zeros unless they are asked for."""
        of, to = self.asked.of, self.asked.to
        changed = with_values(self._parameters, dict([*config, *zip(to, numbers, strict=True)]))
        parameters = changed.model_copy(update={"sensitivities": self.asked if derives else None})
        mesh = f"{parameters.mesh.model_dump()} {parameters.refined_names}"
        solutions = solve_steps(parameters, self._comm, domain=self._domains.get(mesh))
        (last,) = deque(solutions, maxlen=1)
        self._domains[mesh] = last.domain
        if not last.converged:
            raise NotConverged(str(last.reason))
        values = np.array([value_of(name, last) for name in of])
        slopes = np.zeros((len(of), len(to)))
        if derives:
            table = last.facts["sensitivities"]
            slopes[:] = [[table[name][key]["derivative"] for key in to] for name in of]
        return values, slopes


def _vector(numbers: Any, length: int, key: str) -> FloatArray:
    """A vector from JSON.  Raises InputError for anything else."""
    is_right = isinstance(numbers, list) and len(numbers) == length
    if not is_right or any(type(n) not in (int, float) or not abs(n) <= LARGEST for n in numbers):
        raise InputError(f"must be a vector of {length} numbers", key)
    return np.array(numbers, dtype=float)


class _Handler(BaseHTTPRequestHandler):
    """Sends the answers of ``model``, a class attribute, and errors as the protocol has them."""

    model: Model

    def do_GET(self) -> None:
        self._send(b"{}")

    def do_POST(self) -> None:
        self._send(self.rfile.read(int(self.headers.get("Content-Length", 0))))

    def _send(self, request: bytes) -> None:
        try:
            status, answer = 200, self.model.answer(self.path, json.loads(request))
        except (ContactLockingError, ValueError, LookupError, TypeError) as error:
            key = getattr(error, "key", None)
            message = f"{key}: {error}" if key else str(error)
            status, answer = 400, {"error": {"type": type(error).__name__, "message": message}}
        body = json.dumps(answer).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """Nothing: a study asks thousands of times."""


def serve(parameters: Parameters, comm: MPI.Intracomm, host: str, port: int) -> None:
    """Answer one request after the other, until the process is interrupted.

    Port 0 is any free one.  Raises InputError for a study or an address that cannot be served.
    """
    _Handler.model = model = Model(parameters, comm)
    try:
        server = HTTPServer((host, port), _Handler)
    except OSError as error:
        raise InputError(f"{host}:{port} cannot be served at: {error}", "--port") from error
    with server:
        to, of = (", ".join(names) for names in (model.asked.to, model.asked.of))
        url = f"http://{host}:{server.server_port}"
        print(f"{url}  {NAME}({to}) = ({of}); Ctrl-C ends it", flush=True)
        server.serve_forever()
