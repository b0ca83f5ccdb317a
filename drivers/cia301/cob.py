"""COB-IDs: the predefined connection set, the restricted ranges, and a PDO's COB-ID entry (CiA 301 7.3.5)."""

from __future__ import annotations

import enum
from typing import Final, NamedTuple

NMT: Final = 0x000
SYNC: Final = 0x080
EMCY: Final = 0x080
TIME: Final = 0x100
TPDO: Final = (0x180, 0x280, 0x380, 0x480)
RPDO: Final = (0x200, 0x300, 0x400, 0x500)
SDO_RESPONSE: Final = 0x580
SDO_REQUEST: Final = 0x600
HEARTBEAT: Final = 0x700
LSS_RESPONSE: Final = 0x7E4
LSS_REQUEST: Final = 0x7E5

MAX_NODE_ID: Final = 127
MAX_COB_ID: Final = 0x7FF

NO_RTR: Final = 1 << 30
"""In sub-index 1 of a PDO communication record: the PDO can't be asked for by a remote frame."""
_NOT_VALID: Final = 1 << 31
_EXTENDED: Final = 1 << 29


class Service(enum.StrEnum):
    """What a COB-ID of the predefined connection set carries."""

    NMT = "nmt"
    SYNC = "sync"
    EMCY = "emcy"
    TIME = "time"
    TPDO = "tpdo"
    RPDO = "rpdo"
    SDO_REQUEST = "sdo_request"
    SDO_RESPONSE = "sdo_response"
    HEARTBEAT = "heartbeat"
    LSS = "lss"
    OTHER = "other"


_PER_NODE: Final[dict[int, Service]] = {
    EMCY: Service.EMCY,
    **dict.fromkeys(TPDO, Service.TPDO),
    **dict.fromkeys(RPDO, Service.RPDO),
    SDO_RESPONSE: Service.SDO_RESPONSE,
    SDO_REQUEST: Service.SDO_REQUEST,
    HEARTBEAT: Service.HEARTBEAT,
}
_BROADCAST: Final[dict[int, Service]] = {
    NMT: Service.NMT,
    SYNC: Service.SYNC,
    TIME: Service.TIME,
    LSS_RESPONSE: Service.LSS,
    LSS_REQUEST: Service.LSS,
}


def check_node(node: int) -> int:
    """Return `node` if it is a node-ID, 1..127; ValueError otherwise."""
    if not 1 <= node <= MAX_NODE_ID:
        raise ValueError(f"node-ID {node} is not in 1..{MAX_NODE_ID}")
    return node


def emcy(node: int) -> int:
    """COB-ID of the node's emergencies."""
    return EMCY + check_node(node)


def heartbeat(node: int) -> int:
    """COB-ID of the node's heartbeat and boot-up."""
    return HEARTBEAT + check_node(node)


def sdo_request(node: int) -> int:
    """COB-ID on which the node's SDO server listens."""
    return SDO_REQUEST + check_node(node)


def sdo_response(node: int) -> int:
    """COB-ID on which the node's SDO server answers."""
    return SDO_RESPONSE + check_node(node)


def _pdo(bases: tuple[int, ...], number: int, node: int) -> int:
    if not 1 <= number <= len(bases):
        raise ValueError(f"only PDO 1..{len(bases)} have a predefined COB-ID, not {number}")
    return bases[number - 1] + check_node(node)


def tpdo(number: int, node: int) -> int:
    """Predefined COB-ID of the node's transmit PDO 1..4."""
    return _pdo(TPDO, number, node)


def rpdo(number: int, node: int) -> int:
    """Predefined COB-ID of the node's receive PDO 1..4."""
    return _pdo(RPDO, number, node)


def classify(cob_id: int) -> tuple[Service, int]:
    """What the predefined connection set says of a COB-ID, and the node-ID in it (0 where it carries none).

    Never raises: what is in no range, 29-bit identifiers included, is `Service.OTHER`.
    """
    broadcast = _BROADCAST.get(cob_id)
    if broadcast is not None:
        return broadcast, 0
    node = cob_id & MAX_NODE_ID
    service = _PER_NODE.get(cob_id - node)
    if service is None or node == 0:
        return Service.OTHER, 0
    return service, node


_RESTRICTED: Final = (
    range(0x080),
    range(0x101, 0x181),
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x6E0, 0x700),
    range(0x701, 0x780),
    range(0x780, 0x800),
)


def is_restricted(cob_id: int) -> bool:
    """Whether CiA 301 keeps a COB-ID from being given to a configurable object such as a PDO."""
    return any(cob_id in span for span in _RESTRICTED)


class PdoCobId(NamedTuple):
    """Sub-index 1 of a PDO communication record (1400h.., 1800h..)."""

    cob_id: int
    """11 bits; 29 bits only where a foreign device says so."""
    valid: bool = True
    """Whether the PDO exists, that is bit 31 clear."""
    rtr_allowed: bool = False
    """Bit 30 clear. The modules never support RTR, so it stays set (manual §3.1.15)."""

    def encode(self) -> int:
        """As the UNSIGNED32 of the object. ValueError outside 29 bits."""
        if not 0 <= self.cob_id < _EXTENDED:
            raise ValueError(f"COB-ID {self.cob_id:X}h has more than 29 bits")
        frame = _EXTENDED if self.cob_id > MAX_COB_ID else 0
        return self.cob_id | frame | (0 if self.valid else _NOT_VALID) | (0 if self.rtr_allowed else NO_RTR)

    @classmethod
    def decode(cls, value: int) -> PdoCobId:
        """From the UNSIGNED32 of the object; the 11-bit part only, unless bit 29 is set."""
        mask = _EXTENDED - 1 if value & _EXTENDED else MAX_COB_ID
        return cls(value & mask, valid=not value & _NOT_VALID, rtr_allowed=not value & NO_RTR)
