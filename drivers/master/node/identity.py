"""Who is there: 1000h and 1018h against the configured model. Reads only."""

from __future__ import annotations

from drivers.cia301.objects import Address
from drivers.cia301.types import DataType, Value
from drivers.devices.profile import DeviceProfile
from drivers.errors import NodeError, SdoAborted, WrongIdentity
from drivers.master.sdo.answers import DOUBLED, AnswerWatch
from drivers.master.sdo.client import Priority
from drivers.master.sdo.object_access import ObjectAccess
from drivers.master.seen.status import Identity, Particulars

DEVICE_TYPE = Address(0x1000)
VENDOR = Address(0x1018, 1)
PRODUCT = Address(0x1018, 2)
REVISION = Address(0x1018, 3)
SERIAL = Address(0x1018, 4)
DEVICE_NAME = Address(0x1008)
HARDWARE_VERSION = Address(0x1009)
SOFTWARE_VERSION = Address(0x100A)


class DuplicateNode(NodeError):
    """Two nodes answer under one ID."""

    code = "duplicate_node"
    hint = "Give one of the two modules another node ID (2705h or LSS), one at a time on the bus."


async def identify(
    node_id: int, name: str, profile: DeviceProfile, objects: ObjectAccess, answers: AnswerWatch
) -> Particulars:
    """Read who is there. Raises `WrongIdentity`, `DuplicateNode`, `SdoError` or `BusError`."""

    async def read(address: Address, data_type: DataType) -> Value | None:
        """None where the node does not have the object."""
        try:
            return await objects.read_as(address, data_type, priority=Priority.CONFIGURE)
        except SdoAborted:
            return None

    async def number(address: Address) -> int | None:
        value = await read(address, DataType.UNSIGNED32)
        return value if isinstance(value, int) else None

    async def text(address: Address) -> str:
        value = await read(address, DataType.VISIBLE_STRING)
        return value if isinstance(value, str) else ""

    vendor = await number(VENDOR)
    product = await number(PRODUCT)
    device_type = await number(DEVICE_TYPE)
    found = (vendor, product, device_type)
    wanted = (profile.vendor_id, profile.product_code, profile.device_type)
    if found != wanted:
        raise WrongIdentity(
            f"Node {node_id} ({name}) is configured as a {profile.model}, vendor {wanted[0]:X}h, product "
            f"{wanted[1]:X}h, device type {wanted[2]:08X}h; what answers is {_hex(vendor)}, {_hex(product)}, "
            f"{_hex(device_type)}. Nothing was written to it.",
            node=node_id,
        )
    identity = Identity(
        wanted[2], wanted[0], wanted[1], revision=await number(REVISION), serial=await number(SERIAL)
    )
    # Before the strings: the doubled segments of one would only look like a broken protocol.
    for _ in range(DOUBLED):
        if answers.suspicious and not answers.duplicate:
            await number(DEVICE_TYPE)
    if answers.duplicate:
        raise DuplicateNode(
            f"Node {node_id} ({name}) gives more answers than it is asked questions: two nodes have this ID.",
            node=node_id,
        )
    return Particulars(
        identity, await text(DEVICE_NAME), await text(HARDWARE_VERSION), await text(SOFTWARE_VERSION)
    )


def _hex(value: int | None) -> str:
    return "nothing" if value is None else f"{value:X}h"
