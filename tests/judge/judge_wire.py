"""What really went over the bus: how often each target was handed over to each axis."""

from __future__ import annotations

import struct
import threading
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import can

from drivers.cia402.power import Controlword
from drivers.devices.catalog import Catalog
from drivers.master.ground.timing import Timing
from drivers.master.plan.pdo_plan import PdoPlan

POLL = 0.2
MASTER = 127


class SetPoint(NamedTuple):
    """A position that a drive was told to go to."""

    node: int
    axis: int
    target: int


class WireLog:
    """Another participant of the bus, which only listens; `with WireLog(port, nodes) as log:`."""

    def __init__(self, port: int, nodes: Sequence[int]) -> None:
        profile = Catalog.load().profile("TMCM-3216")
        plan = PdoPlan.make(dict.fromkeys(nodes, profile), MASTER, Timing())
        self._axes: dict[int, tuple[int, int]] = {}
        self._with_target: set[int] = set()
        for node, pdos in plan.nodes.items():
            for axis, its in enumerate(pdos.axes):
                for pdo in (its.power, its.position, its.velocity, its.synchronous):
                    self._axes[pdo.cob_id] = (node, axis)
                self._with_target |= {its.position.cob_id, its.synchronous.cob_id}
        self._words: dict[tuple[int, int], int] = {}
        self._bus = can.Bus(interface="socketcand", host="127.0.0.1", port=port, channel="can0")
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="wire log")
        self.handed_over: Counter[SetPoint] = Counter()
        """0-to-1 edges of controlword bit 4, by the target that came with them (manual §6)."""

    def __enter__(self) -> WireLog:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ending.set()
        self._thread.join()
        self._bus.shutdown()

    def _listen(self) -> None:
        while not self._ending.is_set():
            message = self._bus.recv(POLL)
            if message is not None and message.arbitration_id in self._axes:
                self._note(message.arbitration_id, bytes(message.data))

    def _note(self, cob_id: int, data: bytes) -> None:
        axis = self._axes[cob_id]
        (word,) = struct.unpack_from("<H", data)
        before, self._words[axis] = self._words.get(axis, 0), word
        if cob_id in self._with_target and word & ~before & Controlword.NEW_SET_POINT:
            self.handed_over[SetPoint(*axis, *struct.unpack_from("<i", data, 2))] += 1
