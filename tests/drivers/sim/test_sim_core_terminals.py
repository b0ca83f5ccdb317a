"""Digital and analog terminals: 2702h, 2703h, 270Eh, 2711h (manual §4.2.60-68)."""

from __future__ import annotations

import pytest
from sim_core_kit import Bench


def test_inputs_appear_in_bits_16_to_19() -> None:
    bench = Bench()
    for terminal in (0, 3):
        bench.module.terminals.apply(terminal, True)
    assert bench.read(0x2702) == 0x0009_0000
    bench.module.terminals.apply(3, False)
    assert bench.read(0x2702) == 0x0001_0000


def test_outputs_follow_their_mask_and_mode() -> None:
    bench = Bench()
    bench.write(0x2703, 1, 0x000F_0000)
    assert not any(bench.module.terminals.output(terminal) for terminal in range(4))
    bench.write(0x2703, 2, 0x0003_0000)
    bench.write(0x2711, 0, 0b0101, "H")
    assert [bench.module.terminals.output(terminal) for terminal in range(4)] == [True, False, False, False]
    assert bench.read(0x2702) == 0x0001_0000


def test_a_high_side_output_that_is_off_can_be_pulled_up_and_a_push_pull_one_can_not() -> None:
    bench = Bench()
    bench.write(0x2711, 0, 0x0203, "H")
    for terminal in (0, 1):
        bench.module.terminals.apply(terminal, True)
    assert bench.read(0x2702) == 0x0001_0000


def test_analog_inputs() -> None:
    bench = Bench()
    bench.module.terminals.set_analog(1, 4095)
    assert (bench.read(0x270E, 1), bench.read(0x270E, 2)) == (0, 4095)
    with pytest.raises(ValueError, match="4095"):
        bench.module.terminals.set_analog(0, 4096)


def test_an_input_can_be_mapped_and_its_change_is_sent() -> None:
    bench = Bench()
    bench.write(0x1A40, 0, 0, "B")
    bench.write(0x1A40, 1, 0x27020020)
    bench.write(0x1A40, 0, 1, "B")
    bench.write(0x1840, 1, 0x40000182)
    assert "182#00 00 00 00" in bench.start()
    bench.module.terminals.apply(2, True)
    assert bench.poll() == ["182#00 00 04 00"]
