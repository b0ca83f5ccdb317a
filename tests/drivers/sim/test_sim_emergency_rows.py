"""Each row of the manual's EMCY table (§11.2) is provoked, and arrives with its eight bytes.

The table was typed by hand: code, byte #1, byte #2. Bytes #1 that can't be read in the manual's table are
derived (0 for a code with one row, counted for the others); which bits of 1001h go with a code is by CiA 301.
Both are unverified on hardware.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest

from drivers.bus.frame import Frame
from drivers.devices.catalog import Catalog
from drivers.sim.module import SimulatedModule
from drivers.sim.motion.travel import AxisSettings
from drivers.sim.motion.troubles import Bridge

PROFILE = Catalog.load().profile("TMCM-3216")
NODE = 5
MODULE = 255
AXES = (0, 1, 2)
SETTINGS = AxisSettings(
    travel_min=-70_000, travel_max=70_000, negative_limit=-60_000, positive_limit=60_000, home=None
)


class Bench:
    """A module in Operational; frames in, frames out, the time by hand."""

    def __init__(self) -> None:
        self.module = SimulatedModule(PROFILE, NODE, axes=(SETTINGS,) * 3)
        self.now = 10.0
        self.module.power_on(self.now)
        self.sent: list[Frame] = []
        self.frame(0x000, bytes((1, NODE)))

    def frame(self, cob_id: int, data: bytes = b"") -> None:
        self.sent += self.module.on_frame(Frame(cob_id, data), self.now)

    def write(self, index: int, value: int, form: str = "I", sub: int = 0) -> None:
        data = struct.pack("<" + form, value)
        request = struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, sub) + data.ljust(4, b"\0")
        before = len(self.sent)
        self.frame(0x600 + NODE, request)
        answer = next(f for f in self.sent[before:] if f.cob_id == 0x580 + NODE)
        assert answer.data[0] == 0x60, f"{index:04X}h:{sub} = {value}: {answer}"

    def read(self, index: int, form: str = "I", sub: int = 0) -> int:
        before = len(self.sent)
        self.frame(0x600 + NODE, struct.pack("<BHB4x", 0x40, index, sub))
        answer = next(f for f in self.sent[before:] if f.cob_id == 0x580 + NODE)
        return struct.unpack_from("<" + form, answer.data, 4)[0]

    def later(self, seconds: float) -> None:
        end = self.now + seconds
        while (due := self.module.next_wakeup(self.now)) is not None and due <= end:
            self.now = due
            self.sent += self.module.on_time(self.now)
        self.now = end

    def touch(self, change: Callable[[float], object]) -> None:
        """Do something to the module from outside."""
        answer = change(self.now)
        if isinstance(answer, list):
            self.sent += answer
        self.sent += self.module.on_time(self.now)

    def profile(self, index: int, axis: int) -> int:
        return index + (0x800 if index >= 0x6000 else 0x200) * axis

    def run(self, axis: int, velocity: int = 50_000) -> None:
        """Enable the axis in pv and have it run."""
        self.write(self.profile(0x6083, axis), 1_000_000)
        self.write(self.profile(0x6085, axis), 1_000_000)
        self.write(self.profile(0x6060, axis), 3, "b")
        for word in (6, 7, 15):
            self.write(self.profile(0x6040, axis), word, "H")
        self.write(self.profile(0x60FF, axis), velocity, "i")
        self.later(0.2)

    @property
    def emergencies(self) -> list[bytes]:
        return [frame.data for frame in self.sent if frame.cob_id == 0x80 + NODE]


def row(code: int, register: int, cause: int, where: int) -> bytes:
    """The eight bytes, by table 364: code (LSB first), 1001h, additional bytes #1 to #5."""
    return bytes((code & 0xFF, code >> 8, register, cause, where, 0, 0, 0))


# --- rows of one motor: byte #2 is 0, 1 or 2 ---


def open_load(bridge: Bridge) -> Callable[[Bench, int], None]:
    return lambda bench, axis: bench.touch(lambda now: bench.module.axes[axis].open_load(bridge, now))


def short(bridge: Bridge) -> Callable[[Bench, int], None]:
    return lambda bench, axis: bench.touch(lambda now: bench.module.axes[axis].short(bridge, now))


def heat(celsius: float) -> Callable[[Bench, int], None]:
    return lambda bench, axis: bench.touch(lambda now: bench.module.axes[axis].temperature(celsius, now))


def sag(bench: Bench, axis: int) -> None:
    bench.touch(lambda now: bench.module.axes[axis].supply(5.0, now))


def stall(bench: Bench, axis: int) -> None:
    """§4.2.37: above 20A4h the motor is stopped when the load value reaches 0."""
    bench.write(bench.profile(0x20A4, axis), 10_000)
    bench.run(axis)
    assert bench.emergencies == []
    bench.touch(bench.module.axes[axis].block)
    bench.later(0.1)


def deviate(bench: Bench, axis: int) -> None:
    """§6.1.6: encoder and motor differ by more than 6065h."""
    bench.write(bench.profile(0x608F, axis), 51_200, sub=1)
    bench.write(bench.profile(0x606A, axis), 0, "h")
    bench.write(bench.profile(0x6065, axis), 1000)
    bench.run(axis, 10_000)
    bench.touch(bench.module.axes[axis].block)
    assert bench.emergencies == []
    bench.later(0.099)
    assert bench.emergencies == []
    bench.later(0.01)


def software_limit(side: int) -> Callable[[Bench, int], None]:
    def provoke(bench: Bench, axis: int) -> None:
        bench.write(bench.profile(0x607D, axis), -20_000, "i", sub=1)
        bench.write(bench.profile(0x607D, axis), 20_000, "i", sub=2)
        bench.run(axis, side * 50_000)
        assert bench.emergencies == []
        bench.later(1.0)

    return provoke


def limit_switch(side: int) -> Callable[[Bench, int], None]:
    def provoke(bench: Bench, axis: int) -> None:
        bench.run(axis, side * 50_000)
        assert bench.emergencies == []
        bench.later(2.0)

    return provoke


ROWS_OF_A_MOTOR = [
    (0x1000, 1, 0x01, open_load("a")),
    (0x1000, 2, 0x01, open_load("b")),
    (0x2310, 0, 0x03, short("high")),
    (0x2311, 0, 0x03, short("b")),
    (0x2312, 0, 0x03, short("a")),
    (0x3230, 0, 0x05, stall),
    (0x4310, 1, 0x09, heat(130.0)),
    (0x8611, 0, 0x21, deviate),
    (0xFF00, 0, 0x81, sag),
    (0xFF01, 1, 0x81, software_limit(+1)),
    (0xFF01, 2, 0x81, software_limit(-1)),
    (0xFF01, 3, 0x81, limit_switch(+1)),
    (0xFF01, 4, 0x81, limit_switch(-1)),
]


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(("code", "cause", "register", "provoke"), ROWS_OF_A_MOTOR)
def test_a_row_of_a_motor_arrives_with_its_bytes(
    code: int, cause: int, register: int, provoke: Callable[[Bench, int], None], axis: int
) -> None:
    bench = Bench()
    provoke(bench, axis)
    assert bench.emergencies == [row(code, register, cause, axis)]
    assert bench.read(0x1001, "B") == register


@pytest.mark.parametrize("axis", AXES)
def test_overtemperature_comes_after_its_warning(axis: int) -> None:
    bench = Bench()
    heat(130.0)(bench, axis)
    heat(160.0)(bench, axis)
    assert bench.emergencies == [row(0x4310, 0x09, 1, axis), row(0x4310, 0x09, 2, axis)]


@pytest.mark.parametrize("axis", AXES)
def test_a_fault_reset_is_told_with_its_motor_and_an_empty_register(axis: int) -> None:
    bench = Bench()
    short("a")(bench, axis)
    bench.touch(bench.module.axes[axis].mend)
    bench.write(bench.profile(0x6040, axis), 0x80, "H")
    assert bench.emergencies == [row(0x2312, 0x03, 0, axis), row(0x0000, 0x00, 0, axis)]
    assert bench.read(0x1001, "B") == 0


# --- rows of the module: byte #2 is 255 ---


def report(code: int, cause: int) -> Callable[[Bench], None]:
    return lambda bench: bench.touch(lambda now: bench.module.report(code, cause, now))


def shutdown(bench: Bench) -> None:
    bench.run(0)
    bench.touch(lambda now: bench.module.shutdown_switch(True, now))


def lose_heartbeat(bench: Bench) -> None:
    bench.write(0x1016, 127 << 16 | 100, sub=1)
    bench.later(1.0)
    bench.frame(0x77F, b"\5")  # the watch begins with the first one (§3.1.11)
    bench.later(0.09)
    assert bench.emergencies == []
    bench.later(0.02)


def bus_off(bench: Bench) -> None:
    bench.touch(bench.module.bus_off)
    assert bench.emergencies == []
    bench.touch(bench.module.bus_on)


def rpdo(number: int, data: bytes) -> Callable[[Bench], None]:
    """Default mapping of RPDO 2: 6040h and 6060h, three bytes (§3.1.16)."""
    return lambda bench: bench.frame(0x100 * (number + 1) + NODE, data)


ROWS_OF_THE_MODULE = [
    (0x5441, 0, 0x01, shutdown),
    (0x6320, 0, 0x01, rpdo(2, bytes((6, 0, 2)))),
    (0x8100, 0, 0x11, report(0x8100, 0)),
    (0x8110, 1, 0x11, report(0x8110, 1)),
    (0x8110, 2, 0x11, report(0x8110, 2)),
    (0x8110, 3, 0x11, report(0x8110, 3)),
    (0x8120, 0, 0x11, report(0x8120, 0)),
    (0x8130, 0, 0x11, lose_heartbeat),
    (0x8140, 0, 0x11, bus_off),
    (0x8210, 0, 0x11, rpdo(2, bytes((6, 0)))),
    (0x8220, 0, 0x11, rpdo(2, bytes((6, 0, 3, 0)))),
]


@pytest.mark.parametrize(("code", "cause", "register", "provoke"), ROWS_OF_THE_MODULE)
def test_a_row_of_the_module_arrives_with_its_bytes(
    code: int, cause: int, register: int, provoke: Callable[[Bench], None]
) -> None:
    bench = Bench()
    provoke(bench)
    assert bench.emergencies == [row(code, register, cause, MODULE)]


def test_no_row_of_the_manual_is_left_out() -> None:
    provoked = [(code, cause) for code, cause, *_ in (*ROWS_OF_A_MOTOR, *ROWS_OF_THE_MODULE)]
    table = [(0x0000, 0), *provoked, (0x4310, 2)]
    assert len(table) == 26
    assert sorted(table) == sorted((entry.code, entry.detail) for entry in PROFILE.emergencies.rows)


def test_the_register_that_is_sent_is_the_one_that_the_data_names() -> None:
    expected = {(entry.code, entry.detail): entry.register for entry in PROFILE.emergencies.rows}
    for code, cause, register, _ in (*ROWS_OF_A_MOTOR, *ROWS_OF_THE_MODULE):
        assert expected[code, cause] == register


@pytest.mark.parametrize(("code", "cause", "register", "provoke"), ROWS_OF_A_MOTOR)
def test_what_the_data_calls_a_fault_ends_in_fault_and_a_warning_does_not(
    code: int, cause: int, register: int, provoke: Callable[[Bench, int], None]
) -> None:
    bench = Bench()
    bench.run(1, 0)
    provoke(bench, 1)
    bench.later(1.0)
    severity = next(
        row.severity for row in PROFILE.emergencies.rows if (row.code, row.detail) == (code, cause)
    )
    expected = {"fault": 0x08, "warning": 0x27}[severity]
    assert bench.read(0x6841, "H") & 0x6F & ~0x20 == expected & ~0x20
    assert bench.read(0x6041, "H") & 0x4F == 0x40, "the other motors are not concerned"


def test_a_cause_that_lasts_is_reported_again_after_a_reset_of_the_node() -> None:
    bench = Bench()
    open_load("b")(bench, 2)
    bench.frame(0x000, bytes((0x81, NODE)))
    assert bench.emergencies == [row(0x1000, 0x01, 2, 2)] * 2


def test_asking_late_for_the_next_wakeup_loses_nothing() -> None:
    """A shell asks some time after it handed the last frame in: what came due meanwhile is still sent."""
    bench = Bench()
    software_limit(+1)(bench, 0)
    due = Bench()
    due.write(0x607D, 20_000, "i", sub=2)
    due.run(0, 50_000)
    late = due.now + 5.0
    assert due.module.next_wakeup(late) == late
    due.now = late
    due.sent += due.module.on_time(late)
    assert due.emergencies == bench.emergencies == [row(0xFF01, 0x81, 1, 0)]


def test_a_short_pdo_changes_nothing_and_a_long_one_neither() -> None:
    bench = Bench()
    for data in (bytes((6, 0)), bytes((6, 0, 3, 0)), b""):
        rpdo(2, data)(bench)
    assert [data[:2][::-1].hex() for data in bench.emergencies] == ["8210", "8220", "8210"]
    assert (bench.read(0x6040, "H"), bench.read(0x6060, "b")) == (0, 0)
