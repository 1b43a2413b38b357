"""Windows that are drawn with their truth: what is stated of σ²_a and of the flag holds."""

import pytest

from edge_daemon.settings import StabilitySettings
from slipstream_lab.benchmarks.accuracy.drawn import PROCESSES, Judged, honesty, measure


@pytest.mark.long
@pytest.mark.parametrize("process", PROCESSES)
def test_turbulent_windows_are_hardly_ever_called_stable(process: str) -> None:
    """Of 60 of each kind; intervals hold where accelerations vary as the smoother takes them to."""
    found = honesty(measure(process, 60, 1), StabilitySettings())  # type: ignore[arg-type]
    assert found.turbulent >= 10
    assert found.wrongly_stable <= 0.05
    assert found.wrongly_turbulent <= 0.05
    assert found.within >= (0.88 if process == "matern" else 0.7)
    assert found.unknown < 0.5


def test_shares_are_counted_of_what_they_are_of() -> None:
    """By σ²_a or by CV; windows near a threshold are of neither kind."""
    judged = [
        Judged(1.0, 0.05, 0.9, 0.1, 1),
        Judged(1.0, 0.05, 0.5, 0.1, 0),
        Judged(0.1, 0.2, 0.1, 0.1, None),
        Judged(0.1, 0.05, 0.1, 0.1, 0),
        Judged(0.52, 0.05, 0.5, 0.1, 1),
    ]
    found = honesty(judged, StabilitySettings())
    assert (found.windows, found.turbulent) == (5, 3)
    assert found.wrongly_stable == pytest.approx(1 / 3)
    assert (found.wrongly_turbulent, found.unknown) == (1.0, 0.2)
    assert found.within == pytest.approx(0.8)
