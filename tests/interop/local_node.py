"""A drive made of a PyPI canopen LocalNode, run as a process: it judges our master.

It is as simple as a drive can be: each state is reached at once, and each set point in one step. All that it
knows of the bus comes from canopen: SDO server, NMT, heartbeat producer, PDO mapping, EMCY producer.

Usage: python local_node.py EDS NAME=VALUE...; the names are python-can's: interface, channel, port, ...
A set point of 666 makes it send EMCY 8611h (following error) and go to FAULT.
"""

from __future__ import annotations

import struct
import sys
import threading

import canopen
from canopen.pdo import PdoMap

STATES = {6: 0x0021, 7: 0x0023, 15: 0x0027}
VOLTAGE, TARGET_REACHED, BIT_12 = 0x0010, 0x0400, 0x1000


class Axis:
    def __init__(self, node: canopen.LocalNode, number: int) -> None:
        self.node, self.number, self.offset = node, number, 0x800 * number
        self.control = 0
        self.position = 0
        self.state = 0x0040
        self.flags = TARGET_REACHED

    def value(self, index: int, form: str) -> int:
        return struct.unpack("<" + form, self.node.get_data(index + self.offset, 0))[0]

    def store(self, index: int, form: str, value: int) -> None:
        self.node.data_store.setdefault(index + self.offset, {})[0] = struct.pack("<" + form, value)

    def publish(self) -> None:
        enabled = VOLTAGE if self.state not in (0x0040, 0x0008) else 0
        self.store(0x6041, "H", self.state | enabled | self.flags)
        for index in (0x6062, 0x6063, 0x6064):
            self.store(index, "i", self.position)

    def written(self, index: int, data: bytes) -> None:
        if index == 0x6040:
            self.command(struct.unpack("<H", data)[0])
        elif index == 0x6060:
            self.store(0x6061, "b", struct.unpack("<b", data)[0])
        elif index == 0x60FF:
            self.store(0x606C, "i", struct.unpack("<i", data)[0])

    def command(self, word: int) -> None:
        before, self.control = self.control, word
        if word & 0x80 and not before & 0x80:
            self.state = 0x0040
        elif self.state != 0x0008:
            powered = word & 0x06 == 0x06
            self.state = STATES.get(word & 0x0F, self.state) if powered else 0x0040
        rising = word & 0x10 and not before & 0x10
        mode = self.value(0x6061, "b")
        if self.state == 0x0027 and mode == 1:
            if rising:
                self.set_point(bool(word & 0x40))
            elif not word & 0x10:
                self.flags = TARGET_REACHED
        elif self.state == 0x0027 and mode == 6 and rising:
            self.position, self.flags = 0, TARGET_REACHED | BIT_12

    def set_point(self, relative: bool) -> None:
        target = self.value(0x607A, "i")
        if target == 666:
            self.state = 0x0008
            self.node.emcy.send(0x8611, 0x20, bytes([0, self.number, 0, 0, 0]))
            return
        self.position = self.position + target if relative else target
        self.flags = TARGET_REACHED | BIT_12


class Drive:
    def __init__(self, eds: str, **bus: str) -> None:
        self.network = canopen.Network()
        self.network.connect(**bus)
        self.node = canopen.LocalNode(1, eds)
        self.lock = threading.RLock()
        self.axes = [Axis(self.node, number) for number in range(3)]
        for axis in self.axes:
            axis.store(0x606C, "i", 0)
            axis.publish()
        self.mapped = False
        self.node.add_write_callback(self.on_write)
        self.network.add_node(self.node)
        self.node.nmt.state = "INITIALISING"
        self.node.nmt.state = "PRE-OPERATIONAL"

    def on_write(self, index: int, subindex: int, od: object, data: bytes) -> None:
        base = (
            index & 0xF7FF
            if 0x6800 <= index < 0x7000
            else index - 0x1000
            if 0x7000 <= index < 0x7800
            else index
        )
        if base >= 0x6000:
            with self.lock:
                axis = self.axes[(index - base) // 0x800]
                axis.written(base, data)
                axis.publish()

    def on_rpdo(self, pdo: PdoMap) -> None:
        for variable in pdo.map:  # the order of the mapping: the controlword comes first, so act on it last
            if variable.index & 0x7FF != 0x040:
                self.node.set_data(variable.index, variable.subindex, bytes(variable.data))
        for variable in pdo.map:
            if variable.index & 0x7FF == 0x040:
                self.node.set_data(variable.index, variable.subindex, bytes(variable.data))
        self.transmit()

    def transmit(self) -> None:
        with self.lock:
            for pdo in self.node.tpdo.values():
                if pdo.enabled:
                    for variable in pdo.map:
                        variable.data = self.node.get_data(variable.index, variable.subindex)
                    pdo.transmit()

    def run(self) -> None:
        print("ready", flush=True)
        ticks = threading.Event()
        while not ticks.wait(0.05):
            operational = self.node.nmt.state == "OPERATIONAL"
            if operational and not self.mapped:
                self.node.rpdo.read()
                self.node.tpdo.read()
                for pdo in self.node.rpdo.values():
                    if pdo.enabled:
                        pdo.add_callback(self.on_rpdo)
            self.mapped = operational
            if operational:
                self.transmit()


if __name__ == "__main__":
    Drive(sys.argv[1], **dict(option.split("=", 1) for option in sys.argv[2:])).run()
