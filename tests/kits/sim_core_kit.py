"""For the communication half: stand-ins for the axes, and a hand that sends frames and reads clocks."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any, cast

from drivers.bus.frame import Frame
from drivers.cia301.emcy import Emergency
from drivers.cia301.nmt import NmtCommand
from drivers.cia301.sdo import AbortCode, SdoAbort
from drivers.cia402.power import PowerState
from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile
from drivers.sim.interface import AxisParameters, RaiseEmergency
from drivers.sim.module import BuildAxis, SimulatedModule
from drivers.sim.motion.travel import AxisSettings


@lru_cache
def profile() -> DeviceProfile:
    return Catalog.load().profile("TMCM-3216")


class StandIn:
    """An axis that does what the test says; its position is a function of time while it moves."""

    def __init__(
        self, axis: int, parameters: AxisParameters, settings: AxisSettings, raise_emergency: RaiseEmergency
    ) -> None:
        self.axis, self.parameters, self.raise_emergency = axis, parameters, raise_emergency
        self.state = PowerState.SWITCH_ON_DISABLED
        self.speed = 0
        self.statusword = 0x0240
        self.inputs = 0
        self.log: list[tuple] = []
        self.vetoes: dict[int, AbortCode] = {}
        self.failing: set[int] = set()

    @property
    def moving(self) -> bool:
        return bool(self.speed)

    def may_write(self, base_index: int, sub: int, value: int, now: float):
        return self.vetoes.get(base_index)

    def written(self, base_index: int, sub: int, value: int, now: float):
        if base_index in self.failing:
            raise SdoAbort(AbortCode.LOCAL_CONTROL)
        self.log.append((base_index, sub, value))

    def read(self, base_index: int, sub: int, now: float):
        live = {
            0x6041: self.statusword,
            0x6064: round(self.speed * now),
            0x606C: self.speed,
            0x60FD: self.inputs,
        }
        return live.get(base_index)

    def advance(self, now: float):
        pass

    def next_event(self, now: float):
        return None

    def sync(self, now: float):
        self.log.append(("sync", now))

    def nmt_stopped(self, now: float):
        self.log.append(("nmt_stopped", now))

    def reset(self, now: float):
        self.log.append(("reset", now))

    def power_off(self, now: float):
        self.log.append(("power_off", now))


class Bench:
    """A powered module, node 1 unless told otherwise, with stand-ins for its axes."""

    def __init__(self, node_id: int = 1, **options: Any) -> None:
        self.module = SimulatedModule(profile(), node_id, build_axis=cast("BuildAxis", StandIn), **options)
        self.now = 0.0
        self.boot = self.module.power_on(self.now)

    @property
    def axes(self) -> tuple[StandIn, ...]:
        return cast("tuple[StandIn, ...]", self.module.axes)

    @property
    def node(self) -> int:
        assert self.module.node_id is not None
        return self.module.node_id

    def send(self, cob_id: int, data: str | bytes = b"") -> list[str]:
        """What the module answers to a frame, as ``"581#43 00 10 ..."``."""
        payload = bytes.fromhex(data) if isinstance(data, str) else data
        return shown(self.module.on_frame(Frame(cob_id, payload), self.now))

    def nmt(self, command: NmtCommand, node: int = 0) -> list[str]:
        return self.send(0x000, bytes((command, node)))

    def start(self) -> list[str]:
        return self.nmt(NmtCommand.START)

    def sdo(self, request: str) -> str:
        """The response to one SDO request, the first frame that comes; both as hex."""
        answers = self.send(0x600 + self.node, request)
        assert answers, "no answer"
        cob_id, _, data = answers[0].partition("#")
        assert cob_id == f"{0x580 + self.node:03X}"
        return data

    def read(self, index: int, sub: int = 0, form: str = "I") -> int:
        answer = bytes.fromhex(self.sdo(struct.pack("<BHB4x", 0x40, index, sub).hex()))
        assert answer[0] & 0xF0 == 0x40, f"read of {index:04X}h:{sub} aborted: {answer[4:][::-1].hex()}"
        return struct.unpack_from("<" + form, answer, 4)[0]

    def write(self, index: int, sub: int, value: int, form: str = "I") -> int | None:
        """Write; gives the abort code, None if it was taken."""
        data = struct.pack("<" + form, value)
        command = 0x23 | (4 - len(data)) << 2
        answer = bytes.fromhex(
            self.sdo((struct.pack("<BHB", command, index, sub) + data.ljust(4, b"\0")).hex())
        )
        if answer[0] == 0x80:
            return struct.unpack_from("<I", answer, 4)[0]
        assert answer[:4] == struct.pack("<BHB", 0x60, index, sub)
        return None

    def later(self, seconds: float) -> list[str]:
        """Let time pass, from wake-up to wake-up; all that the module sends by then."""
        end = self.now + seconds
        sent: list[str] = []
        while (due := self.module.next_wakeup(self.now)) is not None and due <= end:
            assert due >= self.now, "a wake-up in the past"
            self.now = due
            sent += shown(self.module.on_time(self.now))
        self.now = end
        return sent

    def poll(self) -> list[str]:
        return shown(self.module.on_time(self.now))


def shown(frames: list[Frame]) -> list[str]:
    return [f"{frame.cob_id:03X}#{frame.data.hex(' ')}" for frame in frames]


def axis_fault(axis: int, code: int = 0x2312, register: int = 0x03) -> Emergency:
    return Emergency(code, register, bytes((0, axis, 0, 0, 0)))
