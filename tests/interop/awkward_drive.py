"""A CiA 402 drive that was written from CiA's documents alone, for one axis, with the oddities of real ones.

It shares no code with the product but the frame. Every oddity is a flag, so that a test can have them one by
one or together. A set point is reached at once.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

from drivers.bus.base import Bus
from drivers.bus.frame import Frame

NODE = 1
NO_OBJECT, NO_SUB, READ_ONLY = 0x06020000, 0x06090011, 0x06010002


@dataclass(frozen=True)
class Oddities:
    """What it does that ours does not."""

    sizes_not_indicated: bool = False
    """Expedited answers come with 42h: four bytes, of which nobody says how many count."""
    everything_segmented: bool = False
    """Even one byte is answered in segments, which CiA 301 allows."""
    garbage_in_reserved: bool = False
    """Bytes 4 to 7 of a download's answer are anything."""
    forgets_rtr_bit: bool = False
    """Bit 30 of a COB-ID reads back as 0."""
    padded_pdos: bool = False
    """TPDOs come with eight bytes, whatever is mapped."""
    other_status_bits: int = 0
    """Statusword bits that CiA 402 leaves to the maker: 8, 14, 15."""
    boot_ups: int = 1
    """How often it says 00h in a row."""
    toggling_heartbeat: bool = False
    """Bit 7 alternates, as in node guarding."""
    missing: frozenset[tuple[int, int]] = frozenset()
    """Objects that it does not have."""
    read_only: frozenset[int] = frozenset()
    """Indices that refuse every write."""
    held: dict[tuple[int, int], bytes] = field(default_factory=dict)
    """What it holds from the start."""


class AwkwardDrive:
    """The drive on a bus; `start` and `stop` it."""

    def __init__(self, bus: Bus, sizes: dict[tuple[int, int], int], oddities: Oddities) -> None:
        """`sizes` are those of its objects, in bytes."""
        self.bus = bus
        self.odd = oddities
        self.sizes = {key: size for key, size in sizes.items() if key not in oddities.missing}
        self.values = {key: bytes(size) for key, size in self.sizes.items()} | {
            (0x1000, 0): struct.pack("<I", 0xFFFC0192),
            (0x1018, 1): struct.pack("<I", 0x286),
            (0x1018, 2): struct.pack("<I", 3216),
            (0x1008, 0): b"AWKWARD",
            **oddities.held,
        }
        self.nmt = 0x7F
        self.reply = b""
        self.last_write = (0, 0)
        self.control = 0
        self.state = [0x0240, 0x0240, 0x0240]
        self.beats = 0
        self.tasks: list[asyncio.Task[None]] = []

    async def start(self) -> None:
        await self.bus.open()
        self.bus.subscribe(self.on_frames)
        for _ in range(self.odd.boot_ups):
            self.send(0x700 + NODE, b"\x00")
        self.tasks = [asyncio.create_task(self.beat()), asyncio.create_task(self.publish())]

    async def stop(self) -> None:
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)
        await self.bus.close()

    async def __aenter__(self) -> AwkwardDrive:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()

    def send(self, cob_id: int, data: bytes) -> None:
        self.bus.send(Frame(cob_id, data))

    # --- what it does by itself ---

    async def beat(self) -> None:
        while True:
            period = struct.unpack("<H", self.values.get((0x1017, 0), b"\0\0"))[0] / 1000
            if period:
                toggle = 0x80 * (self.beats % 2) if self.odd.toggling_heartbeat else 0
                self.send(0x700 + NODE, bytes([self.nmt | toggle]))
                self.beats += 1
            await asyncio.sleep(period or 0.02)

    async def publish(self) -> None:
        while True:
            if self.nmt == 5:
                for number in (0x00, 0x01, 0x40, 0x41, 0x80, 0x81):
                    self.transmit(number)
            await asyncio.sleep(0.1)

    def transmit(self, number: int) -> None:
        cob = struct.unpack("<I", self.values[0x1800 + number, 1])[0]
        if cob & 0x80000000:
            return
        data = b"".join(self.values[key] for key in self.mapped(0x1A00 + number))
        self.send(cob & 0x7FF, data.ljust(8, b"\xee") if self.odd.padded_pdos else data)

    def mapped(self, record: int) -> list[tuple[int, int]]:
        entries = [
            struct.unpack("<I", self.values[record, n + 1])[0] for n in range(self.values[record, 0][0])
        ]
        return [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]

    # --- what it is told ---

    def on_frames(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            if frame.error or frame.extended or frame.remote:
                continue
            if frame.cob_id == 0 and frame.data[1] in (0, NODE):
                self.nmt = {1: 5, 2: 4, 128: 0x7F}.get(frame.data[0], self.nmt)
            elif frame.cob_id == 0x600 + NODE and self.nmt != 4:
                self.on_sdo(frame.data)
            elif self.nmt == 5:
                for number in (0x00, 0x01, 0x02, 0x40, 0x41, 0x42, 0x80, 0x81, 0x82):
                    if struct.unpack("<I", self.values[0x1400 + number, 1])[0] & 0x800007FF == frame.cob_id:
                        self.on_pdo(number, frame.data)

    def on_pdo(self, number: int, data: bytes) -> None:
        commands: list[tuple[int, int, bytes]] = []
        for key in self.mapped(0x1600 + number):
            commands.append((*key, data[: self.sizes[key]]))
            data = data[self.sizes[key] :]
        for command in sorted(commands, key=lambda command: command[0] & 0x7FF == 0x040):
            self.write(*command)  # the controlword acts on what comes with it, so it is last
        for each in (0x00, 0x01, 0x40, 0x41, 0x80, 0x81):
            self.transmit(each)

    def on_sdo(self, data: bytes) -> None:
        command, (index, sub) = data[0] >> 5, struct.unpack("<HB", data[1:4])
        if command == 2:
            self.upload(index, sub)
        elif command == 3:
            chunk, self.reply = self.reply[:7], self.reply[7:]
            head = data[0] & 0x10 | (7 - len(chunk)) << 1 | (not self.reply)
            self.answer(bytes([head]) + chunk.ljust(7, b"\0"))
        elif command == 1:
            refused = 0 if (index, sub) in self.sizes else NO_OBJECT
            if index in self.odd.read_only:
                refused = READ_ONLY
            if refused:
                self.abort(index, sub, refused)
                return
            self.write(index, sub, data[4 : 4 + self.sizes[index, sub]])
            rest = b"\xa5\x5a\xa5\x5a" if self.odd.garbage_in_reserved else bytes(4)
            self.answer(b"\x60" + data[1:4] + rest)

    def upload(self, index: int, sub: int) -> None:
        value = self.values.get((index, sub))
        head = struct.pack("<HB", index, sub)
        if value is None or (index, sub) in self.odd.missing:
            self.abort(index, sub, NO_SUB if sub else NO_OBJECT)
        elif len(value) > 4 or self.odd.everything_segmented:
            self.reply = value
            self.answer(b"\x41" + head + struct.pack("<I", len(value)))
        elif self.odd.sizes_not_indicated:
            self.answer(b"\x42" + head + value.ljust(4, b"\xee"))
        else:
            self.answer(bytes([0x43 | (4 - len(value)) << 2]) + head + value.ljust(4, b"\0"))

    def abort(self, index: int, sub: int, code: int) -> None:
        self.answer(b"\x80" + struct.pack("<HBI", index, sub, code))

    def answer(self, data: bytes) -> None:
        self.send(0x580 + NODE, data)

    # --- the drives ---

    def write(self, index: int, sub: int, data: bytes) -> None:
        if 0x1400 <= index < 0x1C00 and sub == 1 and index & 0x200 == 0 and self.odd.forgets_rtr_bit:
            data = struct.pack("<I", struct.unpack("<I", data)[0] & ~0x40000000)
        self.values[index, sub] = data
        if index >= 0x6000:
            axis, base = divmod(index - 0x6000, 0x800)
            if base == 0x040:
                self.command(axis, struct.unpack("<H", data)[0])
            elif base == 0x060:
                self.values[0x6061 + 0x800 * axis, 0] = data
        self.refresh()

    def command(self, axis: int, word: int) -> None:
        offset = 0x800 * axis
        if word & 0x82 == 0x02 and word & 0x04:
            self.state[axis] = {6: 0x0221, 7: 0x0233, 15: 0x0237}.get(word & 0x0F, self.state[axis])
        else:
            self.state[axis] = 0x0240
        if self.state[axis] == 0x0237 and word & 0x10:
            target = struct.unpack("<i", self.values[0x607A + offset, 0])[0]
            if word & 0x40:
                target += struct.unpack("<i", self.values[0x6064 + offset, 0])[0]
            self.values[0x6064 + offset, 0] = struct.pack("<i", target)
            self.state[axis] |= 0x1000
        self.state[axis] |= 0x0400

    def refresh(self) -> None:
        for axis, state in enumerate(self.state):
            self.values[0x6041 + 0x800 * axis, 0] = struct.pack("<H", state | self.odd.other_status_bits)
