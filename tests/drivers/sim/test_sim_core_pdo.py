"""PDOs: defaults, remapping with every refusal, events, timers, SYNC (manual §3.1.15-3.1.18)."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_core_kit import Bench

from drivers.cia301.nmt import NmtCommand
from drivers.cia301.sdo import AbortCode

OFF = 0xC0000000
ON = 0x40000000


def remap(
    bench: Bench, communication: int, cob_id: int, *entries: int, kind: int = 0xFF, **timers: int
) -> None:
    """Remap in the manual's order; every write must be taken."""
    mapping = communication + 0x200
    writes = [(communication, 1, OFF | cob_id, "I"), (mapping, 0, 0, "B")]
    writes += [(mapping, sub, entry, "I") for sub, entry in enumerate(entries, 1)]
    writes += [(mapping, 0, len(entries), "B"), (communication, 2, kind, "B")]
    writes += [(communication, sub, timers[name], "H") for name, sub in TIMERS.items() if name in timers]
    writes += [(communication, 1, ON | cob_id, "I")]
    for index, sub, value, form in writes:
        assert bench.write(index, sub, value, form) is None, f"{index:04X}h:{sub} = {value:X}"


TIMERS = {"inhibit": 3, "event": 5}


def test_on_entering_operational_each_event_driven_pdo_is_sent_once() -> None:
    assert Bench(3).start() == ["183#40 02", "283#40 02 00"]


def test_tpdo_3_comes_with_every_sync_and_carries_the_position() -> None:
    bench = Bench()
    bench.axes[0].speed = -2
    bench.start()
    bench.now = 1.0
    assert bench.send(0x080) == ["381#40 02 fe ff ff ff"]


def test_no_pdo_outside_operational() -> None:
    bench = Bench()
    assert bench.send(0x080) == []
    bench.axes[0].statusword = 0x0231
    assert bench.poll() == []
    assert bench.send(0x201, "06 00") == []
    assert bench.axes[0].log == [("reset", 0.0), ("sync", 0.0)]


def test_a_change_is_sent_at_once_and_only_once() -> None:
    bench = Bench()
    bench.start()
    bench.axes[0].statusword = 0x0231
    assert bench.poll() == ["181#31 02", "281#31 02 00"]
    assert bench.poll() == []
    assert bench.module.next_wakeup(bench.now) is None


def test_a_change_waits_for_the_inhibit_time() -> None:
    bench = Bench()
    remap(bench, 0x1800, 0x181, 0x60410010, inhibit=100)
    assert bench.start()[0] == "181#40 02"
    bench.later(0.004)
    bench.axes[0].statusword = 0x0231
    bench.later(0.001)
    assert [frame for frame in bench.poll() if frame.startswith("181")] == []
    assert bench.module.next_wakeup(bench.now) == pytest.approx(0.010)
    assert bench.later(0.005) == ["181#31 02"]


def test_a_change_that_is_taken_back_within_the_inhibit_time_is_not_sent() -> None:
    bench = Bench()
    remap(bench, 0x1800, 0x181, 0x60410010, inhibit=100)
    bench.start()
    bench.axes[0].statusword = 0x0231
    bench.poll()
    bench.axes[0].statusword = 0x0240
    assert [frame for frame in bench.later(1) if frame.startswith("181")] == []


def test_the_event_timer_repeats_it_unchanged() -> None:
    bench = Bench()
    remap(bench, 0x1800, 0x181, 0x60410010, event=100)
    bench.start()
    assert bench.later(0.35) == ["181#40 02"] * 3


def test_the_inhibit_time_holds_back_the_event_timer_too() -> None:
    bench = Bench()
    remap(bench, 0x1800, 0x181, 0x60410010, event=10, inhibit=1000)
    bench.start()
    assert bench.later(0.35) == ["181#40 02"] * 3


def test_while_an_axis_moves_its_position_is_sampled_each_millisecond_at_most() -> None:
    bench = Bench()
    remap(bench, 0x1800, 0x181, 0x60640020)
    bench.start()
    assert bench.module.next_wakeup(bench.now) is None
    bench.axes[1].speed = 1_000_000
    bench.later(0.01)
    assert bench.module.next_wakeup(bench.now) is None, "another axis moves"
    bench.axes[0].speed = 1_000_000
    bench.poll()
    assert len(bench.later(0.0505)) == 50


def test_while_an_axis_moves_the_inhibit_time_is_the_sampling_time() -> None:
    bench = Bench()
    remap(bench, 0x1800, 0x181, 0x60640020, inhibit=100)
    bench.start()
    bench.axes[0].speed = 1_000_000
    bench.poll()
    assert len(bench.later(0.0505)) == 5


def test_a_pdo_of_switched_values_is_not_sampled_while_an_axis_moves() -> None:
    bench = Bench()
    bench.start()
    bench.axes[0].speed = 1000
    bench.poll()
    assert bench.module.next_wakeup(bench.now) is None


def test_a_synchronous_tpdo_goes_with_every_nth_sync() -> None:
    bench = Bench()
    remap(bench, 0x1802, 0x381, 0x60410010, kind=3)
    bench.start()
    assert [bool(bench.send(0x080)) for _ in range(7)] == [False, False, True, False, False, True, False]


def test_sync_moves_with_1005h_and_may_carry_a_counter() -> None:
    bench = Bench()
    bench.write(0x1005, 0, 0x85)
    bench.start()
    assert bench.send(0x080) == []
    assert len(bench.send(0x085, "07")) == 1
    assert bench.send(0x085, "07 08") == []


def test_an_rpdo_writes_its_set_point_before_the_controlword_that_starts_it() -> None:
    bench = Bench()
    bench.start()
    bench.send(0x401, "1f 00 20 a1 07 00")
    assert bench.axes[0].log[1:] == [(0x607A, 0, 500_000), (0x6040, 0, 0x1F)]


def test_pdos_of_further_axes_begin_disabled_and_can_be_given_an_identifier() -> None:
    bench = Bench()
    assert bench.read(0x1481, 1) == OFF
    remap(bench, 0x1481, 0x202, 0x70400010, 0x70600008)
    bench.start()
    bench.send(0x202, "06 00 01")
    assert bench.axes[2].log[1:] == [(0x6060, 0, 1), (0x6040, 0, 6)]
    assert bench.axes[0].log[1:] == []


def test_one_frame_may_be_two_rpdos() -> None:
    bench = Bench()
    remap(bench, 0x1440, 0x201, 0x68400010)
    bench.start()
    bench.send(0x201, "06 00")
    assert bench.axes[0].log[1:] == bench.axes[1].log[1:] == [(0x6040, 0, 6)]


def test_a_synchronous_rpdo_waits_for_its_sync_and_the_last_one_counts() -> None:
    bench = Bench()
    remap(bench, 0x1400, 0x201, 0x60400010, kind=2)
    bench.start()
    bench.send(0x201, "06 00")
    bench.send(0x201, "07 00")
    bench.send(0x080)
    assert bench.axes[0].log[1:] == [("sync", 0.0)]
    bench.send(0x080)
    assert bench.axes[0].log[2:] == [(0x6040, 0, 7), ("sync", 0.0)]
    bench.send(0x080)
    bench.send(0x080)
    assert bench.axes[0].log[4:] == [("sync", 0.0)] * 2


@pytest.mark.parametrize(
    ("data", "emergency"),
    [("06", "081#10 82 11 00 ff 00 00 00"), ("06 00 00", "081#20 82 11 00 ff 00 00 00")],
)
def test_a_pdo_of_wrong_length_is_not_processed(data: str, emergency: str) -> None:
    bench = Bench()
    bench.start()
    assert bench.send(0x201, data) == [emergency]
    assert bench.axes[0].log[1:] == []
    assert bench.read(0x1001, form="B") == 0, "the error is over with the frame"


def test_a_pdo_with_a_bad_value_is_refused_whole() -> None:
    bench = Bench()
    bench.start()
    assert bench.send(0x301, "06 00 63") == ["081#20 63 01 00 ff 00 00 00"]
    assert bench.axes[0].log[1:] == []


def test_a_pdo_that_the_drive_refuses_gives_6320h() -> None:
    bench = Bench()
    bench.start()
    bench.axes[0].failing.add(0x6040)
    assert bench.send(0x201, "06 00") == ["081#20 63 01 00 ff 00 00 00"]


@pytest.mark.parametrize(
    ("index", "sub", "value", "form", "abort"),
    [
        (0x1800, 1, 0x00000181, "I", AbortCode.INVALID_VALUE),  # RTR bit clear
        (0x1800, 1, 0x80000181, "I", AbortCode.INVALID_VALUE),
        (0x1800, 1, 0x60000181, "I", AbortCode.INVALID_VALUE),  # 29-bit identifier
        (0x1800, 1, 0x40000182, "I", AbortCode.UNSUPPORTED_ACCESS),  # another one while active
        (0x1800, 1, 0x40000181, "I", None),  # the same one
        (0x1800, 1, 0xC0000182, "I", None),
        (0x1840, 1, 0x40000000, "I", AbortCode.INVALID_VALUE),  # NMT's identifier
        (0x1840, 1, 0x40000581, "I", AbortCode.INVALID_VALUE),
        (0x1840, 1, 0x40000182, "I", None),
        (0x1800, 2, 0, "B", AbortCode.VALUE_TOO_LOW),
        (0x1800, 2, 241, "B", AbortCode.INVALID_VALUE),
        (0x1800, 2, 252, "B", AbortCode.INVALID_VALUE),
        (0x1800, 2, 240, "B", None),
        (0x1800, 2, 254, "B", None),
        (0x1800, 3, 100, "H", AbortCode.UNSUPPORTED_ACCESS),  # active
        (0x1840, 3, 100, "H", None),
        (0x1800, 5, 100, "H", None),
        (0x1800, 4, 0, "B", AbortCode.READ_ONLY),
        (0x1400, 3, 0, "H", AbortCode.NO_SUCH_SUB_INDEX),
        (0x1A00, 0, 0, "B", AbortCode.UNSUPPORTED_ACCESS),  # active
        (0x1A00, 1, 0x60640020, "I", AbortCode.UNSUPPORTED_ACCESS),
        (0x1A40, 1, 0x68640020, "I", AbortCode.UNSUPPORTED_ACCESS),  # entries still counted
    ],
)
def test_refusals_of_the_records(index: int, sub: int, value: int, form: str, abort: int | None) -> None:
    bench = Bench()
    if index >= 0x1840 and sub == 2:
        bench.write(index, 1, OFF)
    assert bench.write(index, sub, value, form) == abort


@pytest.mark.parametrize(
    ("mapping", "entry", "abort"),
    [
        (0x1A40, 0x12340020, AbortCode.NO_SUCH_OBJECT),
        (0x1A40, 0x60640120, AbortCode.NO_SUCH_OBJECT),
        (0x1A40, 0x21010020, AbortCode.NOT_MAPPABLE),  # load: live, but not mappable
        (0x1A40, 0x60640010, AbortCode.NOT_MAPPABLE),  # 16 bits of 32
        (0x1A40, 0x60640020, None),
        (0x1A40, 0x27020020, None),
        (0x1A40, 0x00000000, None),
        (0x1640, 0x60640020, AbortCode.NOT_MAPPABLE),  # read only
        (0x1640, 0x27030120, None),
    ],
)
def test_refusals_of_mapping_entries(mapping: int, entry: int, abort: int | None) -> None:
    bench = Bench()
    assert bench.write(mapping, 0, 0, "B") is None
    assert bench.write(mapping, 1, entry) == abort


def test_at_most_three_entries_and_eight_bytes() -> None:
    bench = Bench()
    bench.write(0x1A40, 0, 0, "B")
    for sub, entry in enumerate((0x60640020, 0x606C0020, 0x60410010), 1):
        assert bench.write(0x1A40, sub, entry) is None
    assert bench.write(0x1A40, 4, 0x60410010) == AbortCode.NO_SUCH_SUB_INDEX
    assert bench.write(0x1A40, 0, 4, "B") == AbortCode.PDO_LENGTH_EXCEEDED
    assert bench.write(0x1A40, 0, 3, "B") == AbortCode.PDO_LENGTH_EXCEEDED
    assert bench.write(0x1A40, 0, 2, "B") is None


def test_an_empty_entry_can_not_be_counted() -> None:
    bench = Bench()
    bench.write(0x1A40, 0, 0, "B")
    assert bench.write(0x1A40, 0, 3, "B") == AbortCode.NOT_MAPPABLE


def test_a_pdo_remapped_in_operational_is_sent_as_new() -> None:
    bench = Bench()
    bench.start()
    remap(bench, 0x1840, 0x182, 0x68410010)
    bench.write(0x1840, 1, OFF | 0x182)
    assert bench.send(0x601, "23 40 18 01 82 01 00 40") == ["581#60 40 18 01 00 00 00 00", "182#40 02"]
    bench.axes[1].statusword = 0x0231
    assert bench.poll() == ["182#31 02"]


def test_leaving_operational_forgets_what_waited_for_sync() -> None:
    bench = Bench()
    remap(bench, 0x1400, 0x201, 0x60400010, kind=1)
    bench.start()
    bench.send(0x201, "06 00")
    bench.nmt(NmtCommand.ENTER_PRE_OPERATIONAL)
    bench.start()
    bench.send(0x080)
    assert (0x6040, 0, 6) not in bench.axes[0].log


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("number", [0, 1, 2, 3])
def test_all_twelve_pdos_of_each_direction_can_be_remapped_and_used(axis: int, number: int) -> None:
    bench = Bench()
    step, offset = 0x40 * axis + number, 0x8000000 * axis
    if axis == 0:
        bench.write(0x1400 + step, 1, OFF)
        bench.write(0x1800 + step, 1, OFF)
    remap(bench, 0x1400 + step, 0x350, 0x60FF0020 + offset, 0x60400010 + offset)
    remap(bench, 0x1800 + step, 0x360, 0x60610008 + offset, 0x60FF0020 + offset)
    assert "360#00 00 00 00 00" in bench.start()
    assert "360#00 40 e2 01 00" in bench.send(0x350, "40 e2 01 00 06 00")
    assert bench.axes[axis].log[-2:] == [(0x60FF, 0, 123_456), (0x6040, 0, 6)]


@given(
    inhibit=st.integers(0, 1000),
    event=st.integers(0, 50),
    changes=st.lists(st.tuples(st.floats(0, 0.2), st.integers(0, 3)), min_size=1, max_size=20),
)
def test_no_change_is_lost_and_no_inhibit_time_broken(
    inhibit: int, event: int, changes: list[tuple[float, int]]
) -> None:
    bench = Bench()
    remap(bench, 0x1800, 0x181, 0x60410010, inhibit=inhibit, event=event)
    bench.write(0x1801, 1, OFF)
    sent = [(bench.now, frame) for frame in bench.start()]
    for pause, value in changes:
        sent += timed(bench, pause)
        bench.axes[0].statusword = value
        sent += [(bench.now, frame) for frame in bench.poll()]
    sent += timed(bench, 0.2)
    times = [time for time, _ in sent]
    assert all(b - a >= inhibit / 10_000 - 1e-9 for a, b in pairwise(times))
    assert sent[-1][1] == f"181#{changes[-1][1]:02x} 00"
    if event:
        longest = max(event / 1000, inhibit / 10_000)
        assert all(b - a <= longest + 1e-9 for a, b in pairwise(times))
    else:
        assert all(a[1] != b[1] for a, b in pairwise(sent))
        assert bench.module.next_wakeup(bench.now) is None


def timed(bench: Bench, seconds: float) -> list[tuple[float, str]]:
    """What is sent while time passes, each frame with its time."""
    end = bench.now + seconds
    sent: list[tuple[float, str]] = []
    while (due := bench.module.next_wakeup(bench.now)) is not None and due <= end:
        bench.now = due
        sent += [(bench.now, frame) for frame in bench.poll()]
    bench.now = end
    return sent
