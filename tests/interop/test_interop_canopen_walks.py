"""The manual's three walks by PyPI canopen as the master, against `canaxis simulate` in another process.

Speeds and accelerations are set first: their defaults are 0, and nothing would move (manual §6.1, §8.2).
"""

from __future__ import annotations

import itertools
import struct
import time
from collections.abc import Callable, Iterator

import canopen
import pytest
from canopen_kit import connected, join, simulator

pytestmark = pytest.mark.process

TARGET_REACHED, BIT_12, MOTOR_ACTIVITY = 1 << 10, 1 << 12, 1 << 14


class Drive:
    """One axis behind plain SDO transfers, in the style of the vendor's scripts."""

    def __init__(self, node: canopen.RemoteNode, axis: int) -> None:
        self.sdo = node.sdo
        self.axis = axis

    def _index(self, index: int) -> int:
        return index + self.axis * (0x800 if index >= 0x6000 else 0x200)

    def write(self, index: int, value: int, form: str, sub: int = 0) -> None:
        self.sdo.download(self._index(index), sub, struct.pack("<" + form, value))

    def read(self, index: int, form: str, sub: int = 0) -> int:
        return struct.unpack("<" + form, self.sdo.upload(self._index(index), sub))[0]

    def control(self, word: int) -> None:
        self.write(0x6040, word, "H")

    @property
    def status(self) -> int:
        return self.read(0x6041, "H")

    @property
    def position(self) -> int:
        return self.read(0x6064, "i")

    @property
    def velocity(self) -> int:
        return self.read(0x606C, "i")

    def wait(self, what: Callable[[], bool], seconds: float = 20.0) -> None:
        end = time.monotonic() + seconds
        while not what():
            assert time.monotonic() < end, f"axis {self.axis}: still {self.status:04X}h at {self.position}"
            time.sleep(0.01)

    def switch_on(self, mode: int) -> None:
        """Walk from SWITCH_ON_DISABLED to OPERATION_ENABLED as §6.2 does it."""
        self.write(0x2005, 3, "I")
        for index in (0x2010, 0x6082):
            self.write(index, 10, "I")
        for index in (0x2013, 0x2018, 0x6083, 0x6084):
            self.write(index, 400_000, "I")
        self.write(0x6081, 200_000, "I")
        self.write(0x6067, 0, "I")
        self.write(0x6060, mode, "b")
        for word, state in ((6, 0x21), (7, 0x23), (15, 0x27)):
            self.control(word)
            self.wait(lambda state=state: self.status & 0x6F == state)


@pytest.fixture(scope="module")
def network() -> Iterator[canopen.Network]:
    """PyPI canopen on a bus of simulated modules, one for each test: a reset moves no motor back."""
    with simulator("1-16") as port, connected(port) as network:
        yield network


FRESH = itertools.count(1)
"""The next module that nobody touched."""


@pytest.fixture
def peer(network: canopen.Network) -> canopen.RemoteNode:
    """A module as PyPI canopen's master sees it, operational."""
    node = join(network, next(FRESH))
    node.nmt.state = "OPERATIONAL"
    return node


@pytest.fixture(params=[0, 1, 2])
def drive(peer: canopen.RemoteNode, request: pytest.FixtureRequest) -> Drive:
    return Drive(peer, request.param)


def test_profile_position_walk_to_500000(drive: Drive) -> None:
    drive.switch_on(1)
    drive.write(0x607A, 500_000, "i")
    drive.control(31)
    drive.control(15)  # may be given while the motor is still moving
    drive.wait(lambda: bool(drive.status & MOTOR_ACTIVITY))
    drive.wait(lambda: drive.status & (TARGET_REACHED | BIT_12 | MOTOR_ACTIVITY) == TARGET_REACHED)
    assert drive.position == 500_000
    assert drive.velocity == 0


def test_profile_velocity_walk_at_100000_then_0(drive: Drive) -> None:
    drive.switch_on(3)
    drive.write(0x60FF, 100_000, "i")
    drive.wait(lambda: bool(drive.status & TARGET_REACHED) and drive.velocity == 100_000)
    first = drive.position
    drive.wait(lambda: drive.position > first)
    drive.write(0x60FF, 0, "i")
    drive.wait(lambda: not drive.status & MOTOR_ACTIVITY)
    assert drive.velocity == 0
    assert drive.status & 0x6F == 0x27, "stopping by target velocity 0 leaves the axis enabled"


def test_homing_walk_with_method_19(drive: Drive) -> None:
    drive.switch_on(6)
    drive.write(0x6098, 19, "b")
    drive.write(0x6099, 50_000, "I", 1)
    drive.write(0x6099, 10_000, "I", 2)
    drive.write(0x609A, 200_000, "I")
    drive.control(31)
    drive.wait(lambda: drive.status & (TARGET_REACHED | BIT_12) == TARGET_REACHED | BIT_12)
    drive.control(15)
    assert abs(drive.position) < 10_000 * 10_000 // (2 * 200_000) + 2, (
        "stands within its slow ramp of the switch"
    )
    assert drive.status & 0x6F == 0x27
