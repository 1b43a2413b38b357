"""A browser gets a whole moment first, then only what changes, in a few bytes."""

from __future__ import annotations

from slipstream.messages import CYCLE_KEY, DISPATCHER_HEALTH_KEY, plan_key

S = 1_000_000_000


def _merged(moment, delta):
    """The moment that a browser has after a delta."""
    for table, rows in delta["set"].items():
        for name, row in rows.items():
            moment[table][name] = moment[table].get(name, {}) | row
    for table, names in delta["del"].items():
        for name in names:
            del moment[table][name]
    return moment | {key: value for key, value in delta.items() if key not in ("set", "del")}


def test_a_moment_then_changes_that_lead_to_the_next_one(serve, tell, world, now_ns):
    """Whoever applies the changes has what the server has, packed or not."""
    page = serve()
    tell(page, now_ns)
    page.live.on_cycle(CYCLE_KEY, world.cycle(3, now_ns).to_bytes())
    page.live.on_plan(plan_key("van-a"), world.plan("van-a", 3, now_ns).to_bytes())
    page.present.update(now_ns)
    streams = [page.follow(gzip=True), page.follow(gzip=False)]
    begun = []
    for stream in streams:
        kind, moment = stream.next()
        assert kind == "moment"
        assert moment["roads"]["avenue_east"]["flag"] == "stable"
        begun.append(moment)
    tell(page, now_ns + S, speed_mps=20.0)
    page.present.update(now_ns + S)
    for stream, moment in zip(streams, begun, strict=True):
        kind, delta = stream.next()
        assert kind == "delta"
        assert delta["set"]["roads"] == {"avenue_east": {"kmh": 72}}
        assert _merged(moment, delta) == page.present.known().moment


def test_nothing_new_is_not_sent(serve, tell, world, now_ns):
    """Messages that change nothing of what is shown make no change."""
    page = serve()
    tell(page, now_ns)
    page.present.update(now_ns)
    stream = page.follow()
    _, first = stream.next()
    tell(page, now_ns + S, speed_mps=15.01)
    page.present.update(now_ns + S)
    health = world.dispatcher(now_ns + 2 * S).model_copy(update={"next_cycle_ns": now_ns + 18 * S})
    page.live.on_dispatcher_health(DISPATCHER_HEALTH_KEY, health.to_bytes())
    assert page.present.known().moment["roads"] == first["roads"]
