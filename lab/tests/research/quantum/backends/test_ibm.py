"""A device as a back end that is waited for, against a stand-in of IBM Quantum."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from dispatcher_daemon.solvers.quantum.backends import (
    IbmService,
    ServiceFault,
)
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from slipstream_lab.research.quantum.backends.ibm import IbmBackend
from tests.dispatcher_daemon.solvers.quantum.backends.ibm_stand_in import (
    IbmStandIn,
    opened,
)
from tests.dispatcher_daemon.solvers.quantum.devices import random_chain

CIRCUIT = circuit_of(random_chain(3, 1, 4))


@pytest.fixture(scope="module")
def running() -> Iterator[tuple[IbmStandIn, IbmService]]:
    """The stand-in, and the service that the real client opened there."""
    with opened() as both:
        yield both


@pytest.fixture
def stand_in(running: tuple[IbmStandIn, IbmService]) -> Iterator[IbmStandIn]:
    """The stand-in, whose jobs run again afterwards."""
    yield running[0]
    running[0].runs = True


@pytest.fixture
def service(running: tuple[IbmStandIn, IbmService]) -> IbmService:
    """The service."""
    return running[1]


def fault(do: Any) -> ServiceFault:
    """The fault that a call raises."""
    with pytest.raises(ServiceFault) as caught:
        do()
    return caught.value


@pytest.mark.slow
def test_a_back_end_waits_and_gives_up(stand_in: IbmStandIn, service: IbmService) -> None:
    """Samples with the job's id; a job that is not done in time is cancelled."""
    done = IbmBackend(service, poll_s=0.01).sample(CIRCUIT, 64, 1)
    assert done.job in stand_in.jobs
    assert sum(done.counts.values()) >= 64
    assert (done.two_qubit_depth, done.two_qubit_gates) == (4, 4)
    stand_in.runs = False
    patient = IbmBackend(service, poll_s=0.02)
    assert "not done after 0.1 s" in str(fault(lambda: patient.sample(CIRCUIT, 64, 1, 0.1)))
    assert list(stand_in.jobs.values())[-1].status == "Cancelled"


def test_a_job_that_cannot_be_cancelled_is_still_named(
    stand_in: IbmStandIn, service: IbmService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line of the fault has the job's id, so that it can be cancelled by hand."""

    def refuse(job_id: str) -> None:
        raise ServiceFault("broken", "IBM Quantum: 500")

    stand_in.runs = False
    monkeypatch.setattr(service, "cancel", refuse)
    patient = IbmBackend(service, poll_s=0.02)
    line = str(fault(lambda: patient.sample(CIRCUIT, 64, 1, 0.1)))
    assert f"job {list(stand_in.jobs)[-1]} was not done" in line
    assert line.endswith("could not be cancelled: IBM Quantum: 500")


def test_whoever_stops_waiting_cancels_the_job(
    stand_in: IbmStandIn, service: IbmService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while a job queues takes it out of the queue."""

    def interrupt(job_id: str) -> None:
        raise KeyboardInterrupt

    stand_in.runs = False
    monkeypatch.setattr(service, "look", interrupt)
    with pytest.raises(KeyboardInterrupt):
        IbmBackend(service).sample(CIRCUIT, 64, 1)
    assert list(stand_in.jobs.values())[-1].status == "Cancelled"
