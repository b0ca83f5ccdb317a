"""COB-IDs of the predefined connection set, and their form in PDO records."""

from __future__ import annotations

import pytest

from drivers.cia301 import cob
from drivers.cia301.cob import PdoCobId, Service


@pytest.mark.parametrize(
    ("cob_id", "expected"),
    [
        (0x000, (Service.NMT, 0)),
        (0x080, (Service.SYNC, 0)),
        (0x081, (Service.EMCY, 1)),
        (0x0FF, (Service.EMCY, 127)),
        (0x100, (Service.TIME, 0)),
        (0x181, (Service.TPDO, 1)),
        (0x2FF, (Service.TPDO, 127)),
        (0x383, (Service.TPDO, 3)),
        (0x4FF, (Service.TPDO, 127)),
        (0x201, (Service.RPDO, 1)),
        (0x57F, (Service.RPDO, 127)),
        (0x581, (Service.SDO_RESPONSE, 1)),
        (0x601, (Service.SDO_REQUEST, 1)),
        (0x701, (Service.HEARTBEAT, 1)),
        (0x77F, (Service.HEARTBEAT, 127)),
        (0x7E4, (Service.LSS, 0)),
        (0x7E5, (Service.LSS, 0)),
        (0x001, (Service.OTHER, 0)),
        (0x180, (Service.OTHER, 0)),
        (0x580, (Service.OTHER, 0)),
        (0x700, (Service.OTHER, 0)),
        (0x6E1, (Service.OTHER, 0)),
        (0x7FF, (Service.OTHER, 0)),
        (0x18000601, (Service.OTHER, 0)),
    ],
)
def test_the_predefined_set_names_each_identifier(cob_id: int, expected: tuple[Service, int]) -> None:
    assert cob.classify(cob_id) == expected


def test_each_service_of_node_5_has_its_identifier() -> None:
    assert [cob.emcy(5), cob.heartbeat(5), cob.sdo_request(5), cob.sdo_response(5)] == [
        0x085,
        0x705,
        0x605,
        0x585,
    ]
    assert [cob.tpdo(n, 5) for n in (1, 2, 3, 4)] == [0x185, 0x285, 0x385, 0x485]
    assert [cob.rpdo(n, 5) for n in (1, 2, 3, 4)] == [0x205, 0x305, 0x405, 0x505]


@pytest.mark.parametrize("node", [0, -1, 128, 255])
def test_a_node_id_out_of_range_is_refused(node: int) -> None:
    for make in (cob.emcy, cob.heartbeat, cob.sdo_request, cob.sdo_response):
        with pytest.raises(ValueError, match="node-ID"):
            make(node)


@pytest.mark.parametrize("number", [0, 5, 65])
def test_only_four_pdos_are_predefined(number: int) -> None:
    with pytest.raises(ValueError, match="PDO"):
        cob.tpdo(number, 1)
    with pytest.raises(ValueError, match="PDO"):
        cob.rpdo(number, 1)


@pytest.mark.parametrize(
    ("value", "entry"),
    [
        (0x40000181, PdoCobId(0x181)),  # active, no RTR: as the modules have TPDO 1
        (0xC0000181, PdoCobId(0x181, valid=False)),
        (0xC0000000, PdoCobId(0, valid=False)),  # axes 1 and 2 before a master allocates
        (0x00000201, PdoCobId(0x201, rtr_allowed=True)),
        (0x80000201, PdoCobId(0x201, valid=False, rtr_allowed=True)),
        (0x60012345, PdoCobId(0x12345)),
    ],
)
def test_a_pdo_cob_id_carries_its_flags_in_bits_29_to_31(value: int, entry: PdoCobId) -> None:
    assert entry.encode() == value
    assert PdoCobId.decode(value) == entry


def test_a_pdo_cob_id_of_more_than_29_bits_is_refused() -> None:
    with pytest.raises(ValueError, match="29 bits"):
        PdoCobId(1 << 29).encode()


@pytest.mark.parametrize(
    "cob_id",
    [0x000, 0x001, 0x07F, 0x101, 0x180, 0x581, 0x5FF, 0x601, 0x67F, 0x6E0, 0x6FF, 0x701, 0x77F, 0x780, 0x7FF],
)
def test_restricted_identifiers_are_told(cob_id: int) -> None:
    assert cob.is_restricted(cob_id)


@pytest.mark.parametrize("cob_id", [0x080, 0x081, 0x100, 0x181, 0x57F, 0x580, 0x600, 0x680, 0x6DF, 0x700])
def test_free_identifiers_are_not_restricted(cob_id: int) -> None:
    assert not cob.is_restricted(cob_id)
