"""A `canaxis simulate` process for a whole test module, and raw SDO through PyPI canopen.

Nothing of ours is imported here but the EDS: canopen's own codecs and tables do the rest.
"""

from __future__ import annotations

import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar, cast

import canopen
from canopen.objectdictionary import ODVariable
from repository import ROOT

EDS = ROOT / "drivers" / "devices" / "data" / "tmcm_3216.eds"

TOO_LONG, TOO_SHORT = 0x06070012, 0x06070013
TOO_HIGH, TOO_LOW, NOT_ALLOWED = 0x06090031, 0x06090032, 0x06090030
READ_ONLY, NO_OBJECT, NO_SUB, WRONG_STATE = 0x06010002, 0x06020000, 0x06090011, 0x08000022
AXES = (0, 1, 2)
PATIENCE = 5.0
"""Seconds that an SDO answer may take: the machine may be busy with other things."""

RemoteNodeKind = TypeVar("RemoteNodeKind", bound=canopen.RemoteNode)


class Entry(Protocol):
    """An object, or one entry of it: canopen has three types for them, and only the EDS tells which."""

    raw: Any
    """Read and written by SDO: a number, or the text of a string."""

    def __getitem__(self, sub: int, /) -> Entry: ...


class Objects(Protocol):
    """The object dictionary of a node, read and written by SDO."""

    def __getitem__(self, index: int | str, /) -> Entry: ...


def objects(node: canopen.RemoteNode | canopen.LocalNode) -> Objects:
    """`node.sdo`, for those who know of an object whether it has sub-indices."""
    return cast("Objects", node.sdo)


@contextmanager
def simulator(nodes: str = "1") -> Iterator[int]:
    """A simulated module in a process of its own; gives the port of its socketcand server."""
    command = [sys.executable, "-m", "app", "simulate", "--port", "0", "--nodes", nodes]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        port = 0
        for line in process.stdout:
            if "listens on" in line:
                port = int(line.rsplit(":", 1)[1])
                break
        assert port, f"{command} ended with {process.wait()} before it listened"
        yield port
    finally:
        process.terminate()
        process.wait(timeout=10)
        process.stdout.close()


@contextmanager
def connected(port: int) -> Iterator[canopen.Network]:
    """PyPI canopen's network on the simulator's bus."""
    network = canopen.Network()
    network.connect(interface="socketcand", host="127.0.0.1", port=port, channel="can0")
    try:
        yield network
    finally:
        network.disconnect()


def join(network: canopen.Network, node_id: int = 1) -> canopen.RemoteNode:
    """A node with the whole object dictionary, as canopen reads it from the EDS."""
    return join_as(canopen.RemoteNode, network, node_id)


def join_as(kind: type[RemoteNodeKind], network: canopen.Network, node_id: int) -> RemoteNodeKind:
    """The same, as one of canopen's more special nodes."""
    node = kind(node_id, canopen.import_od(str(EDS), node_id))
    node.sdo.RESPONSE_TIMEOUT = PATIENCE
    network.add_node(node)
    return node


def reset(node: canopen.RemoteNode) -> None:
    """Reset the node, and wait for its boot-up."""
    booted = []
    node.nmt.add_heartbeat_callback(lambda state: booted.append(state) if state == 0 else None)
    node.nmt.send_command(0x81)
    wait(lambda: bool(booted), 5, "boot-up")


def wait(what: Callable[[], bool], seconds: float = 5.0, name: str = "") -> None:
    """Poll until it is so; fails after a while."""
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, f"waited {seconds} s for {name or what}"
        time.sleep(0.005)


def entries(od: canopen.ObjectDictionary) -> Iterator[ODVariable]:
    """Every entry, sub 0 of records and arrays included."""
    for entry in od.values():
        if isinstance(entry, ODVariable):
            yield entry
        else:
            yield from entry.values()


def upload(node: canopen.RemoteNode, index: int, sub: int = 0) -> bytes:
    """All bytes that the node gives: canopen's own `upload` cuts them to the length in the EDS."""
    with node.sdo.open(index, sub, "rb", buffering=0) as stream:
        data = stream.read()
    assert isinstance(data, bytes)
    return data


def refusal(node: canopen.RemoteNode, index: int, sub: int, data: bytes, *, segmented: bool = False) -> int:
    """Write; the abort code, 0 if it was taken."""
    try:
        node.sdo.download(index, sub, data, force_segment=segmented)
    except canopen.SdoAbortedError as error:
        return error.code
    return 0


def read_refusal(node: canopen.RemoteNode, index: int, sub: int) -> int:
    """Read; the abort code, 0 if there was an answer."""
    try:
        upload(node, index, sub)
    except canopen.SdoAbortedError as error:
        return error.code
    return 0


class Axis:
    """One axis by plain SDO, indices as the manual prints them for motor 0 (offsets of §2.6.1)."""

    def __init__(self, node: canopen.RemoteNode, number: int) -> None:
        self.node, self.number = node, number

    def index(self, index: int) -> int:
        return index + self.number * (0x800 if index >= 0x6000 else 0x200)

    def write(self, index: int, value: int, form: str, sub: int = 0) -> None:
        self.node.sdo.download(self.index(index), sub, struct.pack("<" + form, value))

    def refused(self, index: int, value: int, form: str, sub: int = 0) -> int:
        return refusal(self.node, self.index(index), sub, struct.pack("<" + form, value))

    def read(self, index: int, form: str, sub: int = 0) -> int:
        return struct.unpack("<" + form, upload(self.node, self.index(index), sub))[0]

    def control(self, *words: int) -> None:
        for word in words:
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

    def wait(self, mask: int, value: int, seconds: float = 10.0) -> None:
        """Until these bits of the statusword have this value."""
        wait(
            lambda: self.status & mask == value,
            seconds,
            f"status {value:04X}h of {mask:04X}h on axis {self.number}",
        )

    def enable(self, mode: int) -> None:
        self.write(0x6060, mode, "b")
        self.control(0, 6, 7, 15)
        self.wait(0x6F, 0x27)

    def disable(self) -> None:
        self.control(0x80, 0)
        self.wait(0x4F, 0x40)

    def ramps(self, velocity: int, acceleration: int) -> None:
        """Good values where the defaults let no motor run (§1.5, §6.1)."""
        for index in (0x2010, 0x6082):
            self.write(index, 10, "I")
        for index in (0x2013, 0x2018):
            self.write(index, min(acceleration, 16_777_215), "I")
        for index in (0x6083, 0x6084, 0x6085):
            self.write(index, acceleration, "I")
        self.write(0x6081, velocity, "I")
        self.write(0x6067, 0, "I")

    def move(self, target: int) -> None:
        """Go to an absolute position in pp, and wait until the motor is there."""
        self.write(0x607A, target, "i")
        self.control(15, 31, 15)
        self.wait(0x1400, 0x0400)
        assert self.position == target
