"""IBM Quantum's REST service on loopback, as far as qiskit-ibm-runtime asks for it.

It has one device, Boston's calibration snapshot, and executes jobs without noise. Each fault is
told to it by the path that it strikes.
"""

from __future__ import annotations

import json
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import jwt
import pytest

from dispatcher_daemon.solvers.quantum.backends import AccountAccess, IbmService, open_ibm

TOKEN = "key-9f3c-never-to-be-seen"
INSTANCE = "crn:v1:bluemix:public:quantum-computing:us-east:a/1:2::"
DEVICE = "ibm_boston"


@dataclass
class Job:
    """A job as the service keeps it."""

    id: str
    payload: dict[str, Any]
    status: str = "Queued"
    reason: str | None = None
    result: str = ""


@dataclass
class IbmStandIn:
    """State of the service.

    Attributes:
        status: answered instead of the usual, by beginning of the path.
        headers: sent along with such an answer.
        garbage: paths that answer what is no JSON.
        hang_s: paths that answer only after so long.
        runs: whether a submitted job is executed at once; otherwise it stays queued.
        usage_limit_reached: of the plan.
        charge_s: of each job that is done.
        jobs: by id.
        seen: method and path of each request.
    """

    status: dict[str, int] = field(default_factory=dict)
    headers: dict[str, str] = field(default_factory=dict)
    garbage: set[str] = field(default_factory=set)
    hang_s: dict[str, float] = field(default_factory=dict)
    runs: bool = True
    usage_limit_reached: bool = False
    charge_s: float = 3.0
    online: bool = True
    jobs: dict[str, Job] = field(default_factory=dict)
    seen: list[str] = field(default_factory=list)
    address: str = ""

    def answer(self, method: str, path: str, query: dict[str, list[str]], body: bytes) -> Any:
        """What an untroubled service answers; None for 404."""
        match [method, *path.strip("/").split("/")]:
            case ["POST", "identity", "token"]:
                now = int(time.time())
                claims = {"iat": now, "exp": now + 3600}
                bearer = jwt.encode(claims, "x" * 32, algorithm="HS256")
                return {"access_token": bearer, "refresh_token": "-", "expires_in": 3600, **claims}
            case ["GET", "instances", "usage"]:
                return {"usage_limit_reached": self.usage_limit_reached}
            case ["GET", "backends"]:
                status = {"name": "online" if self.online else "offline", "reason": ""}
                return {
                    "devices": [
                        {"name": DEVICE, "status": status, "qubits": 156, "queue_length": 2}
                    ]
                }
            case ["GET", "backends", name, "configuration" | "properties" as what]:
                return _snapshot(what) if name == DEVICE else None
            case ["GET", "backends", name, "status"]:
                return {"state": True, "status": "active", "length_queue": 2}
            case ["POST", "jobs"]:
                job = Job(f"job-{len(self.jobs) + 1}", json.loads(body))
                self.jobs[job.id] = job
                if self.runs:
                    self.execute(job.id)
                return {"id": job.id, "backend": DEVICE}
            case ["GET", "jobs"]:
                wanted = set(query.get("tags", []))
                found = [
                    self._described(job)
                    for job in reversed(self.jobs.values())
                    if wanted <= set(job.payload.get("tags", []))
                ]
                return {"jobs": found, "count": len(found)}
            case ["GET", "jobs", job_id] if job_id in self.jobs:
                return self._described(self.jobs[job_id])
            case ["GET", "jobs", job_id, "results"] if job_id in self.jobs:
                return self.jobs[job_id].result
            case ["GET", "jobs", job_id, "metrics"] if job_id in self.jobs:
                done = self.jobs[job_id].status == "Completed"
                usage = {"status": "final", "qpu_charge_time_seconds": self.charge_s if done else 0}
                return {"usage": usage}
            case ["POST", "jobs", job_id, "cancel"] if job_id in self.jobs:
                self.jobs[job_id].status = "Cancelled"
                return {}
        return None

    def execute(self, job_id: str) -> None:
        """Run a job, by the client's own reading of what was sent, on Aer without noise."""
        from ibm_quantum_schemas.common import CompressedTensorModel
        from ibm_quantum_schemas.executor.version_2_0 import QuantumProgramResultModel
        from qiskit_aer import AerSimulator
        from qiskit_ibm_runtime.fake_provider.executor.run_quantum_program import (
            run_quantum_program,
        )
        from qiskit_ibm_runtime.options_models.simulator import SimulatorOptions
        from qiskit_ibm_runtime.quantum_program.params_converters import (
            QUANTUM_PROGRAM_PARAMS_CONVERTERS,
        )

        job = self.jobs[job_id]
        converter = QUANTUM_PROGRAM_PARAMS_CONVERTERS["v2.0"]
        model = converter.model.model_validate(job.payload["params"])
        program, _ = converter.decoder(model)
        for item in program.items:
            if hasattr(item, "samplex"):
                item.samplex.finalize()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            outcome = run_quantum_program(
                AerSimulator(method="matrix_product_state"),
                program,
                SimulatorOptions(seed_simulator=5),
            )
        data = [
            {
                "results": {k: CompressedTensorModel.from_numpy(v) for k, v in item.items()},
                "metadata": {},
            }
            for item in outcome
        ]
        job.result = QuantumProgramResultModel(
            data=data,
            metadata={"chunk_timing": []},
            passthrough_data=model.quantum_program.passthrough_data,
            semantic_role=model.quantum_program.semantic_role,
        ).model_dump_json()
        job.status = "Completed"

    def _described(self, job: Job) -> dict[str, Any]:
        state = {"status": job.status} | ({"reason": job.reason} if job.reason else {})
        return {
            "id": job.id,
            "backend": DEVICE,
            "status": job.status,
            "state": state,
            "program": {"id": job.payload["program_id"]},
            "tags": job.payload.get("tags", []),
            "created": "2026-11-21T09:00:00Z",
        }


def _snapshot(what: str) -> Any:
    from qiskit_ibm_runtime.fake_provider import FakeBoston

    name = {"configuration": FakeBoston.conf_filename, "properties": FakeBoston.props_filename}
    return json.loads((Path(FakeBoston.dirname) / name[what]).read_text(encoding="utf-8"))


@contextmanager
def serving(stand_in: IbmStandIn) -> Iterator[IbmStandIn]:
    """The service at an address of its own, which is set."""
    over = threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            """Say nothing."""

        def handle_request(self) -> None:
            url = urlsplit(self.path)
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            stand_in.seen.append(f"{self.command} {url.path}")
            over.wait(_struck(stand_in.hang_s, url.path) or 0)
            status = _struck(stand_in.status, url.path)
            if status is not None:
                # Services have been known to tell a caller what it sent.
                line = f"no: {self.headers.get('Authorization')} {TOKEN}"
                error = {"error": {"message": line, "code": 1}}
                self.send(status, json.dumps(error), stand_in.headers)
            elif any(url.path.startswith(path) for path in stand_in.garbage):
                self.send(200, "<html>welcome to the hotel's network</html>", {})
            else:
                answer = stand_in.answer(self.command, url.path, parse_qs(url.query), body)
                text = answer if isinstance(answer, str) else json.dumps(answer)
                self.send(404 if answer is None else 200, text, {})

        do_GET = do_POST = handle_request

        def send(self, status: int, text: str, headers: dict[str, str]) -> None:
            content = text.encode()
            try:
                self.send_response(status)
                for name, value in headers.items():
                    self.send_header(name, value)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(content)))
                self.end_headers()
                self.wfile.write(content)
            except OSError:
                # The client has given up.
                return

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        stand_in.address = f"http://127.0.0.1:{server.server_port}"
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield stand_in
        finally:
            over.set()
            server.shutdown()
            thread.join()


def _struck(faults: dict[str, Any], path: str) -> Any:
    return next((value for begin, value in faults.items() if path.startswith(begin)), None)


@contextmanager
def opened() -> Iterator[tuple[IbmStandIn, IbmService]]:
    """A stand-in, and the service that the real client opens there."""
    with pytest.MonkeyPatch.context() as patch, serving(IbmStandIn()) as stand_in:
        # The client looks its account up elsewhere in IBM's cloud; it can be told not to.
        patch.setenv("QISKIT_FUNCTIONS_EXPERIMENTAL", "1")
        patch.setenv("IAM_URL", stand_in.address)
        yield stand_in, open_ibm(DEVICE, access=AccountAccess(TOKEN, INSTANCE, stand_in.address))
