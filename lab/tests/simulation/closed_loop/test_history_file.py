"""The file of another day's movements, and what time is worth by it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from dispatcher_daemon.fleet.learning import HOURS, History
from slipstream.errors import InputError
from slipstream.roads.sumo_net import load_network
from slipstream.vehicle_types import PRESETS
from slipstream_lab.simulation.closed_loop.history_file import (
    load_history,
    save_history,
    time_worth_kw,
)

CAR = PRESETS["paper_car"]


def known(pairs: Sequence[tuple[str, str]], count: float) -> History:
    """Passages at 8:00, each costing 0.2 kWh and 90 s."""
    table = np.zeros((len(pairs), HOURS))
    table[:, 8] = count
    return History(tuple(pairs), table, 0.2 * table, 90.0 * table, table)


def test_passages_beyond_the_network_are_worth_nothing() -> None:
    """Where the network is the connected part of a larger net, others' traffic leaves it."""
    network = load_network("demo")
    pair = next((a, b) for a in network.segments for b in network.follows[a])
    own = known([pair], 10.0)
    both = History(
        (*own.movements, ("elsewhere", pair[0])),
        *(np.concatenate([t, 7 * t[:1] + 7]) for t in (own.count, own.loss_kwh)),
        *(np.concatenate([t, 7 * t[:1] + 7]) for t in (own.seconds, own.stops)),
    )
    assert time_worth_kw(own, network, CAR) > 0
    assert time_worth_kw(both, network, CAR) == time_worth_kw(own, network, CAR)


def test_a_history_comes_back_from_its_file(tmp_path: Path) -> None:
    """What is saved is loaded, twice the same bytes; anything else is refused in one line."""
    history = known([("a", "b"), ("b", "c")], 3.0)
    path, again = tmp_path / "one.json", tmp_path / "two.json"
    save_history(history, path)
    loaded = load_history(path)
    save_history(loaded, again)
    assert path.read_bytes() == again.read_bytes()
    assert loaded.movements == history.movements
    np.testing.assert_allclose(loaded.loss_kwh, history.loss_kwh, atol=1e-6)
    np.testing.assert_allclose(loaded.seconds, history.seconds, atol=0.01)
    assert [p.name for p in tmp_path.glob("*.part")] == []
    for text in ("{}", "nothing", '{"kind": "slipstream movements 1", "movements": [["a"]]}'):
        path.write_text(text)
        with pytest.raises(InputError, match="not a history"):
            load_history(path)
    with pytest.raises(InputError, match="no such file"):
        load_history(tmp_path / "missing.json")
    path.write_text('{"kind": "other", "movements": []}')
    with pytest.raises(InputError, match="not of the kind"):
        load_history(path)
