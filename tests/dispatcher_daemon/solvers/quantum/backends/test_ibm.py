from __future__ import annotations

import json
import logging
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dispatcher_daemon.solvers.quantum.backends import ibm_account, open_service
from dispatcher_daemon.solvers.quantum.backends.ibm import IbmService, open_ibm
from dispatcher_daemon.solvers.quantum.backends.ibm_account import AccountAccess, find_access
from dispatcher_daemon.solvers.quantum.backends.ibm_faults import ask
from dispatcher_daemon.solvers.quantum.backends.jobs import ServiceFault
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from slipstream.errors import InputError
from tests.dispatcher_daemon.solvers.quantum.backends.ibm_stand_in import (
    DEVICE,
    INSTANCE,
    TOKEN,
    IbmStandIn,
    opened,
)
from tests.dispatcher_daemon.solvers.quantum.devices import frequencies, probabilities, random_chain

CIRCUIT = circuit_of(random_chain(3, 1, 4))


@pytest.fixture(scope="module")
def running() -> Iterator[tuple[IbmStandIn, IbmService]]:
    """The stand-in, and the service that the real client opened there."""
    with opened() as both:
        yield both


@pytest.fixture
def stand_in(running: tuple[IbmStandIn, IbmService]) -> Iterator[IbmStandIn]:
    """The stand-in, healthy again afterwards."""
    stand_in, _ = running
    yield stand_in
    healthy = IbmStandIn()
    for name in ("status", "headers", "garbage", "hang_s", "runs", "usage_limit_reached", "online"):
        setattr(stand_in, name, getattr(healthy, name))


@pytest.fixture
def service(running: tuple[IbmStandIn, IbmService]) -> IbmService:
    """The service."""
    return running[1]


def fault(do: Any) -> ServiceFault:
    """The fault that a call raises, with nothing secret in it."""
    with pytest.raises(ServiceFault) as caught:
        do()
    assert TOKEN not in repr(caught.value) + str(caught.value)
    assert "Bearer ey" not in str(caught.value)
    assert caught.value.__cause__ is None
    assert caught.value.__context__ is None
    return caught.value


@pytest.mark.long
def test_a_job_goes_through_the_real_client(stand_in: IbmStandIn, service: IbmService) -> None:
    """Transpiled, twirled, submitted with its tags and limit, found, done: with the right bits."""
    assert service.name == DEVICE
    job = service.submit(CIRCUIT, 4_000, ["slipstream", "cycle-3"])
    payload = stand_in.jobs[job].payload
    assert payload["tags"] == ["slipstream", "cycle-3"]
    assert payload["cost"] == service.estimate_s(CIRCUIT, 4_000)
    options = payload["params"]["quantum_program"]["passthrough_data"]["post_processor"]["options"]
    assert options["dynamical_decoupling"]["enable"]
    assert options["twirling"]["enable_gates"]
    assert options["twirling"]["enable_measure"]
    view = service.look(job)
    assert view.state == "done"
    assert view.usage_s == stand_in.charge_s
    assert view.counts is not None
    assert sum(view.counts.values()) >= 4_000
    assert np.abs(frequencies(view.counts) - probabilities(CIRCUIT)).max() < 0.04
    assert service.find("cycle-3") == [job]
    assert service.find("cycle-4") == []
    assert service.two_qubit(CIRCUIT) == (4, 4)


@pytest.mark.long
def test_states_of_a_job(stand_in: IbmStandIn, service: IbmService) -> None:
    """Queued, running, cancelled, failed with its reason, and lost."""
    stand_in.runs = False
    job = service.submit(CIRCUIT, 10, [])
    assert service.look(job).state == "queued"
    stand_in.jobs[job].status = "Running"
    assert service.look(job).state == "running"
    service.cancel(job)
    view = service.look(job)
    assert (view.state, view.usage_s, view.counts) == ("cancelled", 0.0, None)
    stand_in.jobs[job].status = "Failed"
    stand_in.jobs[job].reason = f"no such gate {TOKEN}"
    view = service.look(job)
    assert view.state == "failed"
    assert "no such gate" in str(view.reason)
    assert TOKEN not in str(view.reason)
    stand_in.jobs[job].status = "Baked"
    assert fault(lambda: service.look(job)).kind == "garbage"
    assert service.look("job-unknown").state == "lost"
    service.cancel("job-unknown")


@pytest.mark.long
@pytest.mark.parametrize(
    ("status", "kind"),
    [(401, "refused"), (403, "refused"), (429, "limited"), (500, "broken"), (503, "broken")],
)
def test_http_faults_have_their_kinds(
    stand_in: IbmStandIn, service: IbmService, status: int, kind: str
) -> None:
    """Submitting, looking, cancelling and finding all tell what the service answered."""
    job = next(iter(stand_in.jobs), "job-1")
    stand_in.status = {"/jobs": status}
    stand_in.headers = {"Retry-After": "7"}
    for call in (
        lambda: service.submit(CIRCUIT, 10, []),
        lambda: service.look(job),
        lambda: service.cancel(job),
        lambda: service.find("x"),
    ):
        found = fault(call)
        assert (found.kind, found.retry_s) == (kind, 7.0)


@pytest.mark.long
def test_what_is_no_json_is_garbage(stand_in: IbmStandIn, service: IbmService) -> None:
    """A captive portal's page, and a result of the wrong shape."""
    job = service.submit(CIRCUIT, 10, [])
    stand_in.jobs[job].result = json.dumps({"schema_version": "v2.0", "data": "none"})
    assert fault(lambda: service.look(job)).kind == "garbage"
    stand_in.garbage = {"/jobs"}
    for call in (
        lambda: service.submit(CIRCUIT, 10, []),
        lambda: service.look(job),
        lambda: service.find("x"),
    ):
        assert fault(call).kind == "garbage"


@pytest.mark.long
def test_a_hung_answer_ends(
    stand_in: IbmStandIn, service: IbmService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The client's own session would wait for ever; ours ends after its limit, and tries once."""
    monkeypatch.setattr(ibm_account, "READ_S", 1.0)
    stand_in.hang_s = {"/jobs": 30.0}
    stand_in.seen.clear()
    for call in (lambda: service.submit(CIRCUIT, 10, []), lambda: service.find("x")):
        began = time.monotonic()
        assert fault(call).kind == "unreachable"
        assert time.monotonic() - began < 15
    assert stand_in.seen.count("POST /jobs") == 1


def test_a_spent_plan_takes_no_job(stand_in: IbmStandIn, service: IbmService) -> None:
    """The client only warns; the job would wait until there is time again."""
    stand_in.usage_limit_reached = True
    stand_in.seen.clear()
    assert fault(lambda: service.submit(CIRCUIT, 10, [])).kind == "limited"
    assert "POST /jobs" not in stand_in.seen


@pytest.mark.long
@pytest.mark.slow
def test_the_least_busy_device_is_asked_for_anew(
    stand_in: IbmStandIn, service: IbmService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With credentials from the environment; an offline device is none."""
    monkeypatch.setenv(ibm_account.TOKEN, TOKEN)
    monkeypatch.setenv(ibm_account.INSTANCE, INSTANCE)
    monkeypatch.setenv(ibm_account.ADDRESS, stand_in.address)
    opened = open_ibm("least-busy")
    assert opened.name == DEVICE
    assert opened.target.num_qubits == 156
    stand_in.online = False
    assert fault(lambda: open_service("ibm:least-busy")).kind == "broken"


@pytest.mark.long
@pytest.mark.slow
def test_faults_at_the_door(stand_in: IbmStandIn, service: IbmService) -> None:
    """Wrong key, no network and an unknown device are told apart."""
    access = AccountAccess(TOKEN, INSTANCE, stand_in.address)
    with pytest.raises(InputError, match="no device 'ibm_nowhere'; use one of ibm_boston"):
        open_ibm("ibm_nowhere", access=access)
    stand_in.status = {"/backends": 401, "/instances": 401}
    assert fault(lambda: open_ibm(DEVICE, access=access)).kind == "refused"
    stand_in.status = {"/backends": 500}
    assert fault(lambda: open_ibm(DEVICE, access=access)).kind == "broken"
    nobody = AccountAccess(TOKEN, INSTANCE, "http://127.0.0.1:9")
    assert fault(lambda: open_ibm(DEVICE, access=nobody)).kind == "unreachable"


@pytest.mark.long
@pytest.mark.slow
def test_a_charge_is_asked_for_without_the_samples(
    stand_in: IbmStandIn, service: IbmService
) -> None:
    """Done and what it was charged; the result is not fetched."""
    job = service.submit(CIRCUIT, 64, [])
    assert service.look(job).counts is not None
    asked = len(stand_in.seen)
    view = service.look(job, samples=False)
    assert (view.state, view.counts) == ("done", None)
    assert view.usage_s is not None
    assert not any("result" in line for line in stand_in.seen[asked:])


def test_credentials_come_from_the_environment_or_from_systemd(tmp_path: Path) -> None:
    """The environment first, then the credential files; without either, one line."""
    (tmp_path / "ibm-quantum-token").write_text("from-file\n")
    (tmp_path / "ibm-quantum-instance").write_text("crn:file\n")
    folder = {"CREDENTIALS_DIRECTORY": str(tmp_path)}
    assert find_access(folder) == AccountAccess("from-file", "crn:file")
    assert find_access({**folder, "QISKIT_IBM_TOKEN": "from-env"}).token == "from-env"
    assert find_access({"QISKIT_IBM_TOKEN": "t"}) == AccountAccess("t", "auto")
    with pytest.raises(InputError, match="there is no API key; set QISKIT_IBM_TOKEN"):
        find_access({})
    (tmp_path / "ibm-quantum-token").unlink()
    (tmp_path / "ibm-quantum-token").mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        find_access(folder)


@pytest.mark.long
def test_the_token_is_in_no_text(
    stand_in: IbmStandIn, service: IbmService, caplog: pytest.LogCaptureFixture
) -> None:
    """Not in representations, nor in what is logged at any level while a job runs and fails."""
    access = AccountAccess(TOKEN, INSTANCE, stand_in.address)
    with caplog.at_level(logging.DEBUG):
        opened = open_ibm(DEVICE, access=access)
        stand_in.status = {"/jobs": 500}
        fault(lambda: opened.submit(CIRCUIT, 10, []))
    text = repr(access) + repr(opened) + caplog.text
    assert TOKEN not in text
    for value in (RuntimeError(f"with {TOKEN}"), KeyError(TOKEN)):

        def fail(error: Exception = value) -> None:
            raise error

        assert fault(lambda fail=fail: ask(TOKEN, fail)).kind == "garbage"
