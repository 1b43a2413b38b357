"""A driver obeys advice: what is set in SUMO, and what is taken back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import libsumo
import pytest

from lab.tests.simulation.fleet.road import LIMIT_MPS, write_line
from slipstream.messages import VehicleAdvice, VehicleSensing
from slipstream_lab.simulation.fleet.actuation import ALONE, FOLLOWER, SPEED_CHECKS, Driver
from slipstream_lab.simulation.fleet.sensing import sense
from slipstream_lab.simulation.scenarios.scenario import load_scenario
from slipstream_lab.simulation.sumo.session import SumoSession

NAME = "cav/van/0/0"
PARTNER = "cav/other/0/0"
STEP_S = 0.5


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A straight road."""
    return write_line(tmp_path_factory.mktemp("line"))


@pytest.fixture
def session(files: tuple[Path, Path]) -> Iterator[SumoSession]:
    """One vehicle at 20 m/s, on the right lane."""
    net, routes = files
    options = [
        *("--net-file", str(net), "--route-files", str(routes), "--step-length", str(STEP_S)),
        *("--xml-validation", "never", "--no-warnings", "true", "--no-step-log", "true"),
        *("--default.speeddev", "0"),
    ]
    with SumoSession(options, files) as running:
        libsumo.route.add(NAME, ["a", "b", "c"])
        libsumo.vehicle.add(NAME, NAME, ALONE, "now", "0", "100", "20")
        running.advance()
        yield running


def sensing(segment: str = "a") -> VehicleSensing:
    """What the vehicle senses now."""
    return sense(NAME, segment, round(libsumo.simulation.getTime() * 1e9), 0.0)


def advice(mode: str, speed_mps: float | None = None, **fields: Any) -> VehicleAdvice:
    """What an agent advises."""
    told: dict[str, Any] = {
        "vehicle": "van",
        "time_ns": 0,
        "valid_until_ns": 1,
        "cycle": 1,
        "leg": 0,
        "mode": mode,
        "speed_mps": speed_mps,
        "gap_m": None,
        "lane": None,
        "partner": None,
        "depart_ns": None,
        "green_at": None,
        "text": "",
        "reason": None,
    }
    return VehicleAdvice.model_validate(told | fields)


def drive(
    session: SumoSession, driver: Driver, told: VehicleAdvice | None, seconds: float = 20.0
) -> float:
    """Speed after a while of the same advice."""
    for _ in range(round(seconds / STEP_S)):
        driver.obey(told, sensing())
        session.advance()
    return float(libsumo.vehicle.getSpeed(NAME))


def test_a_driver_begins_with_checks_and_its_pace(session: SumoSession) -> None:
    """All checks stay on whatever is advised; the pace is its desired speed over the limit."""
    driver = Driver(NAME, pace=0.8)
    driver.begin()
    assert libsumo.vehicle.getSpeedMode(NAME) == SPEED_CHECKS
    assert drive(session, driver, None) == pytest.approx(0.8 * LIMIT_MPS, abs=0.1)


@pytest.mark.parametrize(
    ("told", "mps"),
    [
        pytest.param(None, LIMIT_MPS, id="no advice"),
        pytest.param(advice("none"), LIMIT_MPS, id="none"),
        pytest.param(advice("cruise", 12.0), LIMIT_MPS, id="cruise alone"),
        pytest.param(advice("cruise", 12.0, partner="other"), 12.0, id="cruise, waiting"),
        pytest.param(advice("cruise", 90.0, partner="other"), LIMIT_MPS, id="cruise, above"),
        pytest.param(advice("speed", 12.0), 12.0, id="speed"),
        pytest.param(advice("speed", 0.0), 0.0, id="halt"),
        pytest.param(advice("follow", 12.0, partner="other"), 12.0, id="follow"),
        pytest.param(advice("open_gap", 12.0, partner="other"), 12.0, id="open gap"),
    ],
)
def test_each_kind_of_advice_is_driven_and_ends(
    session: SumoSession, told: VehicleAdvice | None, mps: float
) -> None:
    """The speed is reached; without advice the driver is back at its own, with its own type."""
    driver = Driver(NAME)
    driver.begin()
    reached = drive(session, driver, told)
    assert reached == pytest.approx(mps, rel=0.01, abs=0.02)
    close = told is not None and told.mode in ("follow", "open_gap")
    assert driver.close == close
    assert libsumo.vehicle.getTypeID(NAME) == (FOLLOWER if close else ALONE)
    assert libsumo.vehicle.getSpeedMode(NAME) == SPEED_CHECKS
    assert drive(session, driver, None, 40.0) == pytest.approx(LIMIT_MPS, rel=0.01)
    assert not driver.close
    assert libsumo.vehicle.getTypeID(NAME) == ALONE
    assert libsumo.vehicle.getSpeedMode(NAME) == SPEED_CHECKS
    assert libsumo.vehicle.getSpeedFactor(NAME) == pytest.approx(1.0)


def test_after_a_close_gap_a_driver_has_its_pace_again(session: SumoSession) -> None:
    """SUMO resets the factor with the type; it is set anew, both ways."""
    driver = Driver(NAME, pace=0.8)
    driver.begin()
    for told in (advice("follow", 20.0, partner="other"), None, advice("open_gap", 20.0)):
        driver.obey(told, sensing())
        assert libsumo.vehicle.getSpeedFactor(NAME) == pytest.approx(0.8)
    assert drive(session, driver, None) == pytest.approx(0.8 * LIMIT_MPS, abs=0.1)


def test_who_follows_changes_no_lane_on_its_own(session: SumoSession) -> None:
    """A close gap has its own lane-change mode; afterwards it is the driver's again."""
    driver = Driver(NAME)
    driver.begin()
    before = libsumo.vehicle.getLaneChangeMode(NAME)
    driver.obey(advice("follow", 20.0, partner="other"), sensing())
    assert libsumo.vehicle.getLaneChangeMode(NAME) != before
    driver.obey(None, sensing())
    assert libsumo.vehicle.getLaneChangeMode(NAME) == before


def test_a_wanted_lane_is_taken(session: SumoSession) -> None:
    """One that does not exist is not."""
    driver = Driver(NAME)
    driver.begin()
    driver.obey(advice("cruise", 30.0, partner="other", lane=7), sensing())
    session.advance()
    assert libsumo.vehicle.getLaneIndex(NAME) == 0
    drive(session, driver, advice("cruise", 30.0, partner="other", lane=1), 3.0)
    assert libsumo.vehicle.getLaneIndex(NAME) == 1


def test_who_is_close_no_more_is_handed_over_after_a_while(session: SumoSession) -> None:
    """Three seconds while the agent commands the speed; at once where it commands nothing."""
    driver = Driver(NAME)
    driver.begin()
    drive(session, driver, advice("follow", 20.0, partner="other"), STEP_S)
    drive(session, driver, advice("speed", 20.0), 2.5)
    assert not driver.close
    assert libsumo.vehicle.getTypeID(NAME) == FOLLOWER
    drive(session, driver, advice("speed", 20.0), 1.0)
    assert libsumo.vehicle.getTypeID(NAME) == ALONE
    drive(session, driver, advice("open_gap", 20.0, partner="other"), STEP_S)
    assert libsumo.vehicle.getTypeID(NAME) == FOLLOWER
    driver.obey(advice("cruise", 20.0), sensing())
    assert libsumo.vehicle.getTypeID(NAME) == ALONE


def test_a_partner_that_leaves_by_the_other_lane_of_a_fork_stops_nobody(
    files: tuple[Path, Path],
) -> None:
    """3.3 m ahead at 19 m/s, where one lane of the corridor's exit becomes two."""
    net = load_scenario("corridor").net
    options = [
        *("--net-file", str(net), "--route-files", str(files[1]), "--step-length", str(STEP_S)),
        *("--no-step-log", "true", "--default.speeddev", "0"),
    ]
    with SumoSession(options, (net, files[1])) as running:
        for name, last, at_m in ((PARTNER, "s9-ts9", 180.0), (NAME, "s9-n9", 80.0)):
            libsumo.route.add(name, ["e9_leave", "e9_off", last])
            libsumo.vehicle.add(name, name, ALONE, "now", "0", str(at_m), "19")
        front, driver = Driver(PARTNER), Driver(NAME)
        running.advance()
        # So near to each other SUMO lets nobody in.
        driver.obey(advice("open_gap", 19.0), sensing("e9_leave"))
        length_m = libsumo.vehicle.getLength(PARTNER)
        behind_m = libsumo.vehicle.getLanePosition(PARTNER) - length_m - 3.3
        libsumo.vehicle.moveTo(NAME, "e9_leave_0", behind_m)
        modes, speeds = set(), []
        for _ in range(12):
            leader = sense(PARTNER, "e9_leave", round(running.time_s * 1e9), 0.0)
            front.obey(advice("speed", 19.0), leader)
            sensed = sensing("e9_leave")
            is_behind = sensed.ahead is not None and sensed.ahead.vehicle == "other"
            mode = "open_gap" if is_behind else "speed"
            driver.obey(advice(mode, 18.9), sensed)
            running.advance()
            modes.add(mode)
            speeds.append(libsumo.vehicle.getSpeed(NAME))
    assert modes == {"open_gap", "speed"}
    assert min(speeds) > 15.0
