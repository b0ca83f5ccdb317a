"""Configuration, requests, ramps and the guard: what is refused before a frame is sent."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.devices.layout import AxisLayout
from drivers.errors import BadValue
from drivers.master import AxisConfig, HomeRequest, MoveRequest, NetworkConfig, NodeConfig, VelocityRequest
from drivers.master.guard import Guard, guard_of
from drivers.master.ramps import move_duration


@pytest.mark.parametrize(
    "wrong",
    [
        {"name": ""},
        {"name": "7"},
        {"velocity": 0},
        {"deceleration": 16_777_216},
        {"end_velocity": 9},
        {"start_velocity": 100, "end_velocity": 50},
        {"steps_per_unit": 0.0},
        {"steps_per_unit": float("nan")},
        {"soft_limits": (5, 5)},
        {"switch_parameters": 64},
    ],
)
def test_an_axis_that_could_not_move_well_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(BadValue):
        AxisConfig(**{"name": "x", **wrong})


def test_software_limits_are_corrected_by_the_home_offset() -> None:
    assert AxisConfig(name="x", soft_limits=(-10, 100), home_offset=20).target_range == (-30, 80)


def test_nodes_must_differ_and_leave_the_master_its_id() -> None:
    one = NodeConfig(1, "a")
    for nodes in ((one, NodeConfig(1, "b")), (one, NodeConfig(2, "a")), (NodeConfig(127, "m"),)):
        with pytest.raises(BadValue):
            NetworkConfig(nodes)


def test_the_master_s_heartbeat_is_at_most_a_third_of_what_modules_wait() -> None:
    with pytest.raises(BadValue, match="three times"):
        NetworkConfig(heartbeat_ms=200, consumer_ms=500)


@pytest.mark.parametrize(
    "make",
    [
        lambda: MoveRequest(2**31),
        lambda: MoveRequest(0, velocity=0),
        lambda: MoveRequest(0, acceleration=-1),
        lambda: VelocityRequest(2**24),
        lambda: HomeRequest(fast=0),
        lambda: HomeRequest(timeout_s=0),
    ],
)
def test_requests_beyond_the_module_are_refused(make) -> None:
    with pytest.raises(BadValue):
        make()


def test_the_guard_knows_every_axis() -> None:
    layout = AxisLayout(3)
    never = (0x6040, 0x6840, 0x7040, 0x6060, 0x7060, 0x5FFF)
    confirm = (0x1010, 0x1016, 0x1029, 0x1400, 0x1A83, 0x2205, 0x2405, 0x20A2, 0x24A3, 0x2706, 0x705A, 0x687D)
    free = (0x6081, 0x2000, 0x6883, 0x6064, 0x1008)
    assert {guard_of(index, layout) for index in never} == {Guard.NEVER}
    assert {guard_of(index, layout) for index in confirm} == {Guard.CONFIRM}
    assert {guard_of(index, layout) for index in free} == {Guard.FREE}


@given(st.floats(0, 1e9), st.floats(1, 1e7), st.floats(1, 1e7), st.floats(1, 1e7))
def test_a_move_takes_at_least_what_its_velocity_allows(
    distance: float, velocity: float, acceleration: float, deceleration: float
) -> None:
    duration = move_duration(distance, velocity, acceleration, deceleration)
    assert duration >= distance / velocity * 0.999999
    assert duration <= distance / velocity + velocity / acceleration + velocity / deceleration + 1e-6


def test_a_triangle_and_a_trapezoid() -> None:
    assert move_duration(100, 1000, 100, 100) == pytest.approx(2.0)
    assert move_duration(2000, 100, 100, 100) == pytest.approx(21.0)
    assert move_duration(0, 100, 100, 100) == 0
