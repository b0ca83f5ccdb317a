"""An axis on a test bench: the manual's defaults as parameters, and a clock in the hand of the test."""

from __future__ import annotations

from drivers.cia301.emcy import Emergency
from drivers.cia402.power import PowerState, decode_state
from drivers.sim.motion.axis import SimulatedAxis
from drivers.sim.motion.travel import AxisSettings

DEFAULTS: dict[tuple[int, int], int] = {
    (0x2000, 0): 8,
    (0x2001, 0): 200,
    (0x200B, 3): 1,
    (0x208C, 0): 181,
    (0x605A, 0): 2,
    (0x605C, 0): 1,
    (0x605D, 0): 1,
    (0x605E, 0): 2,
    (0x6067, 0): 0xFFFF_FFFF,
    (0x606A, 0): -1,
    (0x607D, 1): -(2**31),
    (0x607D, 2): 2**31 - 1,
    (0x6085, 0): 51_200,
    (0x608F, 1): 1,
    (0x60C2, 1): 1,
    (0x60C2, 2): -3,
}


class Stored:
    """The stored objects: what isn't in the table of defaults is 0."""

    def __init__(self) -> None:
        self.values = dict(DEFAULTS)

    def get(self, base_index: int, sub: int = 0) -> int:
        return self.values.get((base_index, sub), 0)

    def set(self, base_index: int, sub: int, value: int) -> None:
        self.values[base_index, sub] = value


class Bench:
    """One axis; `now` goes on only by `wait` and its like."""

    def __init__(self, settings: AxisSettings | None = None, *, axis: int = 0) -> None:
        self.parameters = Stored()
        self.emergencies: list[Emergency] = []
        self.now = 100.0
        self.axis = SimulatedAxis(axis, self.parameters, settings or AxisSettings(), self.emergencies.append)
        self.axis.reset(self.now)

    def write(self, index: int, value: int, sub: int = 0) -> None:
        assert self.axis.may_write(index, sub, value, self.now) is None
        self.parameters.set(index, sub, value)
        self.axis.written(index, sub, value, self.now)

    def control(self, *words: int) -> None:
        for word in words:
            self.write(0x6040, word)

    def read(self, index: int) -> int:
        value = self.axis.read(index, 0, self.now)
        assert value is not None
        return value

    def wait(self, seconds: float) -> None:
        self.now += seconds
        self.axis.advance(self.now)

    def wait_for_events(self, limit: float = 1000.0) -> None:
        """Until nothing is going to happen any more; fails if that takes longer than `limit` seconds."""
        end = self.now + limit
        while (event := self.axis.next_event(self.now)) is not None:
            assert event <= end, f"still busy after {limit} s"
            self.now = max(event, self.now)

    def ramp(
        self, velocity: int = 50_000, acceleration: int = 100_000, deceleration: int | None = None
    ) -> None:
        """Good values for pp and pv."""
        self.write(0x6081, velocity)
        self.write(0x6083, acceleration)
        self.write(0x6084, acceleration if deceleration is None else deceleration)
        self.write(0x6082, 10)

    def enable(self, mode: int) -> None:
        self.write(0x6060, mode)
        self.control(0, 6, 7, 15)
        assert self.state is PowerState.OPERATION_ENABLED

    def move(self, target: int, *, relative: bool = False) -> None:
        self.write(0x607A, target)
        word = 0x4F if relative else 0x0F
        self.control(word, word | 0x10)

    @property
    def state(self) -> PowerState:
        state = decode_state(self.statusword)
        assert state is self.axis.state
        return self.axis.state

    @property
    def statusword(self) -> int:
        return self.read(0x6041)

    def bit(self, number: int) -> bool:
        return bool(self.statusword >> number & 1)

    @property
    def position(self) -> int:
        return self.read(0x6064)

    @property
    def demand(self) -> int:
        return self.read(0x6062)

    @property
    def velocity(self) -> int:
        return self.read(0x606C)

    def heard(self) -> list[tuple[int, int, int]]:
        """Code, byte #1 and byte #2 of each emergency so far, and forget them."""
        heard = [(e.code, e.data[0], e.data[1]) for e in self.emergencies]
        self.emergencies.clear()
        return heard
