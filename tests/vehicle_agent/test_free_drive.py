"""The time of a free drive."""

import pytest

from vehicle_agent.free_drive import free_drive_s


def test_a_free_drive_is_that_of_constant_acceleration_up_to_the_limit() -> None:
    """10 s from rest to 18 m/s take 90 m; each further 18 m another second."""
    assert free_drive_s(90.0, 0.0, 18.0) == pytest.approx(10.0)
    assert free_drive_s(108.0, 0.0, 18.0) == pytest.approx(11.0)
    assert free_drive_s(36.0, 20.0, 18.0) == pytest.approx(2.0)
    assert free_drive_s(22.5, 0.0, 18.0) == pytest.approx(5.0)
