"""What the status TPDOs make of a status."""

from __future__ import annotations

import itertools

from drivers.cia402.modes import Mode
from drivers.cia402.objects import DigitalInput
from drivers.cia402.power import PowerState
from drivers.master.seen.status import AxisStatus, Reference, Switches

BEFORE = AxisStatus(position=7, velocity=8, reference=Reference.HOMED, updated=1.0, stale=False)


def test_a_statusword_is_taken_apart_and_the_rest_is_kept() -> None:
    status = BEFORE.with_status(0x5637, 1, 0, updated=2.0, stale=False)
    assert status == AxisStatus(
        state=PowerState.OPERATION_ENABLED,
        mode=Mode.PROFILE_POSITION,
        statusword=0x5637,
        position=7,
        velocity=8,
        target_reached=True,
        moving=True,
        reference=Reference.HOMED,
        updated=2.0,
        stale=False,
    )


def test_a_mode_and_a_state_that_nobody_knows_are_none() -> None:
    status = BEFORE.with_status(0x0001, -7, 0, updated=2.0, stale=False)
    assert (status.state, status.mode) == (None, Mode.NO_MODE)


def test_each_switch_is_its_own_bit_whatever_else_the_inputs_say() -> None:
    bits = (DigitalInput.NEGATIVE_LIMIT, DigitalInput.POSITIVE_LIMIT, DigitalInput.HOME_SWITCH)
    for shown in itertools.product((False, True), repeat=3):
        inputs = 0xFFFF0000 | sum(bit for bit, on in zip(bits, shown, strict=True) if on)
        status = BEFORE.with_status(0, 0, inputs, updated=2.0, stale=False)
        assert status.switches == Switches(*shown)


def test_a_motion_changes_position_velocity_and_age_alone() -> None:
    before = BEFORE.with_status(0x5637, 3, int(DigitalInput.HOME_SWITCH), updated=1.0, stale=True)
    status = before.with_motion(-5, 6, updated=3.0, stale=False)
    assert status == before._replace(position=-5, velocity=6, updated=3.0, stale=False)
