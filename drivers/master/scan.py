"""Who is on a bus, and what it is: the identity of every node that answers, all asked at once."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.bus.base import Bus
from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.objects import Address
from drivers.cia301.sdo import Done, SdoUpload, Send

ANSWER = 0.3
"""Seconds that a node gets for each answer."""
PACE = 0.001
"""Seconds between two requests, so that no queue fills up."""
DEVICE_TYPE, DEVICE_NAME = Address(0x1000, 0), Address(0x1008, 0)
VENDOR, PRODUCT, SERIAL = Address(0x1018, 1), Address(0x1018, 2), Address(0x1018, 4)
FIRST_ID, LAST_ID = 1, 127


@dataclass(frozen=True, slots=True)
class FoundNode:
    """What a node says of itself; None where it doesn't answer for an object that CiA 301 leaves optional."""

    node_id: int
    name: str | None
    vendor_id: int | None
    product_code: int | None
    serial: int | None


async def scan(bus: Bus) -> tuple[FoundNode, ...]:
    """Ask every node ID. Nothing is written, and no node is reset or started.

    Not while a service runs on the bus: each would take the other's answers. Raises `BusDown`.
    """
    await bus.open()
    try:
        present = sorted(await _read_all(bus, DEVICE_TYPE, range(FIRST_ID, LAST_ID + 1)))
        names = await _read_all(bus, DEVICE_NAME, present)
        vendors = await _read_all(bus, VENDOR, present)
        products = await _read_all(bus, PRODUCT, present)
        serials = await _read_all(bus, SERIAL, present)
    finally:
        await bus.close()
    return tuple(
        FoundNode(
            node_id,
            names[node_id].decode("latin-1").rstrip("\0") if node_id in names else None,
            _number(vendors, node_id),
            _number(products, node_id),
            _number(serials, node_id),
        )
        for node_id in present
    )


def _number(answers: dict[int, bytes], node_id: int) -> int | None:
    return int.from_bytes(answers[node_id], "little") if node_id in answers else None


async def _read_all(bus: Bus, address: Address, nodes: Sequence[int]) -> dict[int, bytes]:
    """One object of many nodes at once; whoever doesn't answer in time, or refuses, is left out."""
    transfers = {node_id: SdoUpload(address) for node_id in nodes}
    done: dict[int, bytes] = {}

    def on_frames(frames: Sequence[Frame]) -> None:
        for frame in frames:
            node_id = frame.cob_id - cob.SDO_RESPONSE
            if frame.error or frame.extended or node_id not in transfers or node_id in done:
                continue
            step = transfers[node_id].feed(frame.data)
            if isinstance(step, Send):
                bus.send(Frame(cob.sdo_request(node_id), step.data))
            elif isinstance(step, Done):
                done[node_id] = step.data

    end = bus.subscribe(on_frames)
    try:
        for node_id, transfer in transfers.items():
            bus.send(Frame(cob.sdo_request(node_id), transfer.request()))
            await asyncio.sleep(PACE)
        await asyncio.sleep(ANSWER if nodes else 0.0)
    finally:
        end()
    return done
