"""Configuration, requests, ramps and the guard: what is refused before a frame is sent."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from repository import ROOT

from drivers.devices.layout import AxisLayout
from drivers.errors import BadValue
from drivers.master import AxisConfig, HomeRequest, MoveRequest, NetworkConfig, NodeConfig, VelocityRequest
from drivers.master.node.guarded_objects import Guard, guard_of


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
def test_requests_beyond_the_module_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(BadValue):
        make()


DANGEROUS = [0x1010, 0x1011, 0x1014, 0x1016, 0x1017, 0x1029, 0x2703, 0x2704, 0x2705, 0x2706, 0x2711, 0x5FFF]
DANGEROUS += [0x1400, 0x15FF, 0x1600, 0x17FF, 0x1800, 0x19FF, 0x1A00, 0x1BFF]  # PDO records, first and last
OF_EACH_AXIS = [0x2003, 0x2005, 0x200C, 0x20A1, 0x20A2, 0x20A3, 0x605A, 0x605E, 0x6065, 0x607D]


@pytest.mark.parametrize("base", OF_EACH_AXIS)
@pytest.mark.parametrize("axis", range(3))
def test_what_is_dangerous_is_dangerous_on_every_axis(base: int, axis: int) -> None:
    layout = AxisLayout(3)
    assert guard_of(layout.index(base, axis), layout) is Guard.CONFIRM


@pytest.mark.parametrize("index", DANGEROUS)
def test_what_is_dangerous_for_the_module_needs_a_confirmation(index: int) -> None:
    assert guard_of(index, AxisLayout(3)) is Guard.CONFIRM


@pytest.mark.parametrize("base", [0x6040, 0x6060])
@pytest.mark.parametrize("axis", range(3))
def test_controlword_and_mode_are_the_axis_s_alone(base: int, axis: int) -> None:
    layout = AxisLayout(3)
    assert guard_of(layout.index(base, axis), layout) is Guard.NEVER


def test_the_guard_knows_every_axis() -> None:
    layout = AxisLayout(3)
    never = (0x6040, 0x6840, 0x7040, 0x6060, 0x7060)
    confirm = (0x1010, 0x1016, 0x1029, 0x1400, 0x1A83, 0x2205, 0x2405, 0x20A2, 0x24A3, 0x2706, 0x705A, 0x687D)
    free = (0x6081, 0x2000, 0x6883, 0x6064, 0x1008)
    assert {guard_of(index, layout) for index in never} == {Guard.NEVER}
    assert {guard_of(index, layout) for index in confirm} == {Guard.CONFIRM}
    assert {guard_of(index, layout) for index in free} == {Guard.FREE}


def test_the_page_about_security_names_what_is_guarded_and_nothing_else() -> None:
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    told = page.split("The dangerous objects: ", 1)[1].split(". ", 1)[0]
    named: set[int] = set()
    for first, last in re.findall(r"\b([0-9A-F]{4})h(?:\s+to\s+([0-9A-F]{4})h)?", told):
        named |= set(range(int(first, 16), int(last or first, 16) + 1))
    one_axis = AxisLayout(1)
    assert named == {index for index in range(0x10000) if guard_of(index, one_axis) is Guard.CONFIRM}
