"""What is wrong, the worst first; silence behind a dead bus is no trouble of its own."""

from __future__ import annotations

from dashboard.live import Snapshot
from dashboard.view.roads import open_roads, road_limits, road_views
from dashboard.view.rsus import rsu_views
from dashboard.view.troubles import troubles
from dashboard.view.vehicles import vehicle_views
from slipstream.messages import Alarm, Alarms

S = 1_000_000_000


def _troubles(snapshot, now_ns):
    roads = road_views(snapshot, now_ns, road_limits(snapshot.dispatcher, 5.0))
    vans = vehicle_views(snapshot, now_ns, open_roads(roads))
    rsus = rsu_views(snapshot.rsus, now_ns, 5.0)
    return troubles(snapshot, roads, rsus, vans, now_ns)


def _well(world, now_ns, **changes):
    health = world.health("avenue_east", now_ns)
    known = {
        "rsus": {health.rsu: health},
        "cycles": (world.cycle(1, now_ns),),
        "dispatcher": world.dispatcher(now_ns),
    }
    return Snapshot(**(known | changes))


def test_all_is_well(world, now_ns):
    """Nothing is told."""
    assert _troubles(_well(world, now_ns), now_ns) == ()


def test_silence_is_named_in_time(world, now_ns):
    """Dispatcher and unit, each once its messages are overdue; texts have no running ages."""
    other = world.health("avenue_west", now_ns + 9 * S)
    unit = world.health("avenue_east", now_ns)
    silent = _well(world, now_ns, rsus={unit.rsu: unit, other.rsu: other})
    told = _troubles(silent, now_ns + 9 * S)
    assert [one.subject for one in told] == ["dispatcher", "rsu/rsu-avenue_east"]
    assert {one.level for one in told} == {"bad"}
    assert {one.since_ns for one in told} == {now_ns}
    later = _troubles(silent, now_ns + 11 * S)
    assert [one.text for one in later] == [one.text for one in told]


def test_if_all_fall_silent_at_once_it_is_the_bus(world, now_ns):
    """Though its link stands, and before any of them is overdue; one that was silent before, or
    is dated ahead, makes no two of one."""
    unit, later = world.health("avenue_east", now_ns), world.health("avenue_west", now_ns + 9 * S)
    both = _well(world, now_ns)
    assert _troubles(both, now_ns + 3 * S) == ()
    (told,) = _troubles(both, now_ns + 3 * S + 1)
    assert (told.subject, told.since_ns) == ("bus", now_ns)
    assert [one.subject for one in _troubles(both, now_ns + 60 * S)] == ["bus"]
    for rsus in (
        {},
        {later.rsu: later},
        {unit.rsu: world.health("avenue_east", now_ns + 3600 * S)},
    ):
        told = _troubles(_well(world, now_ns, rsus=rsus), now_ns + 14 * S)
        assert "bus" not in [one.subject for one in told]
        assert "dispatcher" in [one.subject for one in told]


def test_a_dead_bus_is_named_alone(world, now_ns):
    """Who is silent behind it is not, and a missing database still is."""
    snapshot = _well(world, now_ns, connected=False, has_database=False)
    told = _troubles(snapshot, now_ns + 9 * S)
    assert [one.subject for one in told] == ["bus", "database"]


def test_each_camera_without_a_picture_is_named(world, now_ns):
    """The 37th of 50 too."""
    healths = [
        world.health(f"road-{number}", now_ns, "no_signal" if number == 36 else "ok")
        for number in range(50)
    ]
    snapshot = _well(world, now_ns, rsus={health.rsu: health for health in healths})
    (told,) = _troubles(snapshot, now_ns)
    assert (told.subject, told.level) == ("rsu/rsu-road-36", "bad")
    assert told.text == "Camera rsu-road-36: no picture"


def test_the_dispatchers_alarms_are_told_worst_first(world, now_ns):
    """Not those that ended, are information, or that the page tells already."""

    def alarm(name, severity, subject, **more):
        return Alarm(
            id=name,
            severity=severity,
            kind="x",
            subject=subject,
            since_ns=now_ns,
            ended_ns=more.pop("ended_ns", None),
            text=name,
            mend=None,
            **more,
        )

    alarms = (
        alarm("late", "warning", "vehicle/van-a"),
        alarm("full", "critical", "database"),
        alarm("seen", "critical", "cluster", acknowledged_by="kim", acknowledged_ns=now_ns),
        alarm("over", "critical", "rsu/rsu-9", ended_ns=now_ns),
        alarm("note", "info", "order/o-1"),
    )
    snapshot = _well(world, now_ns, alarms=Alarms(time_ns=now_ns, alarms=alarms))
    told = [(one.subject, one.level) for one in _troubles(snapshot, now_ns)]
    assert told == [("database", "bad"), ("cluster", "warn"), ("vehicle/van-a", "warn")]
    # A lesser trouble of the dispatcher hides no alarm of it; the same told twice is one.
    busy = world.dispatcher(now_ns).model_copy(update={"messages_lost": 3})
    both = Alarms(
        time_ns=now_ns, alarms=(alarm("no solver works", "critical", "dispatcher"), alarms[0])
    )
    found = _troubles(_well(world, now_ns, alarms=both, dispatcher=busy), now_ns)
    assert [one.text for one in found][:2] == [
        "no solver works",
        "The dispatcher has 3 messages lost",
    ]
    paused = world.dispatcher(now_ns).model_copy(update={"paused": True})
    same = (alarms[0].model_copy(update={"kind": "paused", "subject": "dispatcher"}),)
    told = Alarms(time_ns=now_ns, alarms=same)
    (only,) = _troubles(_well(world, now_ns, alarms=told, dispatcher=paused), now_ns)
    assert only.text == "Planning is paused"
