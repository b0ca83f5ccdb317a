"""All 24 PDOs remapped by PyPI canopen's own PDO API, and used: events, timers, inhibit time, SYNC, refusals.

The module runs in another process. Times are real: lower bounds are the module's, upper ones generous.
"""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Iterator, Sequence

import canopen
import pytest
from canopen.pdo import PdoMap
from canopen_kit import (
    NO_OBJECT,
    NOT_ALLOWED,
    TOO_LOW,
    connected,
    join,
    objects,
    refusal,
    reset,
    simulator,
    upload,
    wait,
)

pytestmark = pytest.mark.process

# §1.1, §3.1.15: PDO numbers of the three axes.
NUMBERS = [(axis, 64 * axis + own) for axis in range(3) for own in (1, 2, 3, 4)]
SOME = [(0, 1), (1, 66), (2, 132)]
EXCEEDS, NOT_MAPPABLE, ACTIVE = 0x06040042, 0x06040041, 0x06010000
# §4.2.60, §4.2.61, §4.2.67, §5, §6, §7, §9, §10: everything with "PDO mapping: yes", and its bits.
MAPPABLE_RW = {0x6040: 16, 0x6060: 8, 0x607A: 32, 0x6081: 32, 0x6083: 32, 0x6084: 32}
MAPPABLE_RW |= {0x60B0: 32, 0x60B1: 32, 0x60FF: 32}
MAPPABLE_RO = {0x6041: 16, 0x6061: 8, 0x6062: 32, 0x6063: 32, 0x6064: 32, 0x606C: 32, 0x60FD: 32}
MODULE_RW, MODULE_RO = [(0x2703, 1)], [(0x2702, 0), (0x270E, 1), (0x270E, 2)]
UNMAPPABLE = [
    (0x2003, 0, 8),
    (0x2101, 0, 16),
    (0x2102, 0, 8),
    (0x210A, 0, 16),
    (0x2121, 0, 8),
    (0x2122, 0, 32),
]
UNMAPPABLE += [(0x6065, 0, 32), (0x6082, 0, 32), (0x6085, 0, 32), (0x607C, 0, 32), (0x607D, 1, 32)]
UNMAPPABLE += [
    (0x6098, 0, 8),
    (0x60C2, 1, 8),
    (0x6502, 0, 32),
    (0x1001, 0, 8),
    (0x1018, 1, 32),
    (0x2703, 2, 32),
]


def profile(index: int, axis: int) -> int:
    return index + 0x800 * axis


def manufacturer(index: int, axis: int) -> int:
    return index + 0x200 * axis if 0x2000 <= index < 0x2200 else index


@pytest.fixture(scope="module")
def shared() -> Iterator[canopen.RemoteNode]:
    with simulator() as port, connected(port) as network:
        node = join(network)
        node.tpdo.read()  # so that canopen knows that bit 30 must stay set
        node.rpdo.read()
        yield node


@pytest.fixture
def node(shared: canopen.RemoteNode) -> canopen.RemoteNode:
    reset(shared)
    return shared


class Arrivals:
    """What a TPDO brought, and when, from the moment this is made."""

    def __init__(self, pdo: PdoMap) -> None:
        self.data: list[bytes] = []
        self.times: list[float] = []
        self._lock = threading.Lock()
        pdo.callbacks[:] = [self._take]

    def _take(self, pdo: PdoMap) -> None:
        assert pdo.timestamp is not None
        with self._lock:
            self.data.append(bytes(pdo.data))
            self.times.append(pdo.timestamp)

    def wait(self, count: int) -> None:
        wait(lambda: len(self.data) >= count, 5, f"{count} PDOs, got {self.data}")


def transmit_cob_id(position: int) -> int:
    """Free on this bus: the predefined TPDO 1 of nodes 32 and on."""
    return 0x1A0 + position


def receive_cob_id(position: int) -> int:
    return 0x220 + position


def set_up(
    pdo: PdoMap, cob_id: int, entries: Sequence[int | tuple[int, int]], kind: int, **timing: int
) -> None:
    pdo.clear()
    for entry in entries:
        index, sub = entry if isinstance(entry, tuple) else (entry, 0)
        assert pdo.add_variable(index, sub) is not None
    pdo.cob_id, pdo.trans_type, pdo.enabled = cob_id, kind, True
    pdo.inhibit_time, pdo.event_timer = timing.get("inhibit"), timing.get("timer")
    pdo.save()


def settle(node: canopen.RemoteNode) -> None:
    """All that the module had to send before is here: an SDO answer comes after it."""
    upload(node, 0x1000)


def test_the_records_of_all_24_are_as_canopen_expects_them(node: canopen.RemoteNode) -> None:
    for pdos, base in ((node.rpdo, 0x200), (node.tpdo, 0x180)):
        pdos.read()
        assert sorted(pdos) == [number for _, number in NUMBERS]
        for axis, number in NUMBERS:
            pdo = pdos[number]
            assert not pdo.rtr_allowed, "bit 30 must be set"
            own = number - 64 * axis
            assert pdo.enabled == (axis == 0 and own <= 3)
            if axis == 0:
                assert pdo.cob_id == base + 0x100 * (own - 1) + 1
    indices = {number: [variable.index for variable in node.tpdo[number]] for _, number in NUMBERS}
    for axis, number in NUMBERS:
        second = [[], [0x6061], [0x6064], [0x606C]][number - 64 * axis - 1]
        assert indices[number] == [profile(index, axis) for index in (0x6041, *second)]


def test_each_of_the_12_rpdos_carries_what_is_mapped_into_it(node: canopen.RemoteNode) -> None:
    node.nmt.state = "OPERATIONAL"
    for position, (axis, number) in enumerate(NUMBERS):
        pdo = node.rpdo[number]
        target, velocity = profile(0x607A, axis), profile(0x60FF, axis)
        set_up(pdo, receive_cob_id(position), [target, velocity], 0xFF)
        pdo[0].raw, pdo[1].raw = -1000 - number, 2000 + number
        pdo.transmit()
        wait(lambda velocity=velocity, number=number: objects(node)[velocity].raw == 2000 + number)
        assert objects(node)[target].raw == -1000 - number
        set_up(pdo, receive_cob_id(position), [velocity, target, profile(0x6060, axis)][:2], 0xFE)
        pdo[0].raw, pdo[1].raw = 7, 8
        pdo.transmit()
        wait(lambda velocity=velocity: objects(node)[velocity].raw == 7)
        assert objects(node)[target].raw == 8


def test_each_of_the_12_tpdos_comes_on_a_change_and_with_its_timer(node: canopen.RemoteNode) -> None:
    node.nmt.state = "OPERATIONAL"
    for position, (axis, number) in enumerate(NUMBERS):
        pdo = node.tpdo[number]
        arrivals = Arrivals(pdo)
        status, target = profile(0x6041, axis), profile(0x607A, axis)
        set_up(pdo, transmit_cob_id(position), [status, target], 0xFF, timer=0)
        settle(node)
        arrivals = Arrivals(pdo)
        objects(node)[target].raw = 4711 + number
        arrivals.wait(1)
        word = objects(node)[status].raw
        settle(node)
        assert arrivals.data == [struct.pack("<Hi", word, 4711 + number)], "once for one change"
        arrivals = Arrivals(pdo)
        objects(node)[target].raw = 4711 + number
        settle(node)
        assert arrivals.data == [], "no change, no event timer"
        set_up(pdo, transmit_cob_id(position), [target], 0xFE, timer=15)
        arrivals = Arrivals(pdo)
        arrivals.wait(4)
        assert set(arrivals.data) == {struct.pack("<i", 4711 + number)}
        assert arrivals.times[-1] - arrivals.times[0] >= 0.015 * (len(arrivals.times) - 1) / 2
        set_up(pdo, transmit_cob_id(position), [target], 0xFE, timer=0)


@pytest.mark.parametrize("number", [1, 68, 131])
def test_the_inhibit_time_keeps_tpdos_apart_and_the_last_value_arrives(
    node: canopen.RemoteNode, number: int
) -> None:
    axis = number // 64
    node.nmt.state = "OPERATIONAL"
    pdo, target = node.tpdo[number], profile(0x607A, axis)
    set_up(pdo, transmit_cob_id(0), [target], 0xFF, inhibit=1000, timer=0)
    settle(node)
    arrivals = Arrivals(pdo)
    began = time.monotonic()
    value = 0
    while time.monotonic() - began < 0.6:
        objects(node)[target].raw = value = value + 1
    took = time.monotonic() - began
    wait(lambda: arrivals.data[-1:] == [struct.pack("<i", value)])
    mean = (arrivals.times[-1] - arrivals.times[0]) / (len(arrivals.times) - 1)
    assert mean > 0.08, "100 ms, as far as a busy machine stamps them in time"
    assert len(arrivals.data) <= took / 0.1 + 3


def test_each_of_the_12_tpdos_comes_with_every_third_sync(node: canopen.RemoteNode) -> None:
    node.nmt.state = "OPERATIONAL"
    network = node.network
    for position, (axis, number) in enumerate(NUMBERS):
        set_up(node.tpdo[number], transmit_cob_id(position), [profile(0x607A, axis)], 3)
        objects(node)[profile(0x607A, axis)].raw = number
    arrivals = {number: Arrivals(node.tpdo[number]) for _, number in NUMBERS}
    for sync in range(1, 8):
        network.sync.transmit()
        settle(node)
        for number, got in arrivals.items():
            assert len(got.data) == sync // 3, (number, sync)
    # The PDOs of a node share their axis's target: the last number written holds.
    for axis, number in NUMBERS:
        assert arrivals[number].data[-1] == struct.pack("<i", 64 * axis + 4)


def test_each_of_the_12_tpdos_comes_with_every_sync_and_only_then(node: canopen.RemoteNode) -> None:
    node.nmt.state = "OPERATIONAL"
    for position, (axis, number) in enumerate(NUMBERS):
        set_up(node.tpdo[number], transmit_cob_id(position), [profile(0x607A, axis)], 1)
    arrivals = {number: Arrivals(node.tpdo[number]) for _, number in NUMBERS}
    for axis in range(3):
        objects(node)[profile(0x607A, axis)].raw = 99
    settle(node)
    assert not any(got.data for got in arrivals.values())
    for sync in (1, 2, 3):
        node.network.sync.transmit()
        settle(node)
        assert {len(got.data) for got in arrivals.values()} == {sync}
    node.nmt.state = "PRE-OPERATIONAL"
    node.network.sync.transmit()
    settle(node)
    assert {len(got.data) for got in arrivals.values()} == {3}, "no PDO outside of Operational"


@pytest.mark.parametrize("kind", [1, 3])
def test_each_of_the_12_rpdos_waits_for_its_sync(node: canopen.RemoteNode, kind: int) -> None:
    node.nmt.state = "OPERATIONAL"
    own_target = {1: 0x607A, 2: 0x60B0, 3: 0x60FF, 4: 0x60B1}
    targets = [(number, profile(own_target[number - 64 * axis], axis)) for axis, number in NUMBERS]
    for position, (number, target) in enumerate(targets):
        set_up(node.rpdo[number], receive_cob_id(position), [target], kind)
    for value in (1, 2):  # of two before a SYNC the last one counts
        for number, _target in targets:
            node.rpdo[number][0].raw = value * 1000 + number
            node.rpdo[number].transmit()
    settle(node)
    for sync in range(1, kind + 1):
        assert [objects(node)[target].raw for _, target in targets] == [0] * 12, f"before SYNC {sync}"
        node.network.sync.transmit()
    settle(node)
    assert [objects(node)[target].raw for _, target in targets] == [2000 + number for number, _ in targets]


def test_every_object_that_can_be_mapped_is_mapped_and_comes_with_its_value(node: canopen.RemoteNode) -> None:
    node.nmt.state = "OPERATIONAL"
    for axis in range(3):
        pdo = node.tpdo[64 * axis + 2]
        objects = [(profile(index, axis), 0) for index in {**MAPPABLE_RW, **MAPPABLE_RO}]
        for index, sub in [*objects, *MODULE_RO, *MODULE_RW]:
            set_up(pdo, transmit_cob_id(axis), [(index, sub)], 1)
            arrivals = Arrivals(pdo)
            node.network.sync.transmit()
            arrivals.wait(1)
            assert arrivals.data[0] == upload(node, index, sub), hex(index)


def test_every_object_that_can_be_written_is_taken_from_an_rpdo(node: canopen.RemoteNode) -> None:
    node.nmt.state = "OPERATIONAL"
    for axis in range(3):
        pdo = node.rpdo[64 * axis + 3]
        for index, sub in [*((profile(index, axis), 0) for index in MAPPABLE_RW), *MODULE_RW]:
            set_up(pdo, receive_cob_id(axis), [(index, sub)], 0xFF)
            value = {0x6040: 6, 0x6060: 3}.get(index - 0x800 * axis, 0x30000 + axis)
            pdo[0].raw = value
            pdo.transmit()
            expected = value.to_bytes(len(pdo.data), "little")
            wait(lambda i=index, s=sub, e=expected: upload(node, i, s) == e, 2, hex(index))


def test_three_entries_and_eight_bytes_are_the_most(node: canopen.RemoteNode) -> None:
    for axis, number in SOME:
        for base, pdos in ((0x1600, node.rpdo), (0x1A00, node.tpdo)):
            pdo, mapping = pdos[number], base + number - 1
            set_up(pdo, 0x1F0, [profile(index, axis) for index in (0x6040, 0x6060, 0x607A)], 0xFF)
            assert pdo.length == 56
            pdo.enabled = False
            pdo.save()
            assert refusal(node, mapping, 0, b"\4") == EXCEEDS, "four entries"
            assert refusal(node, mapping, 0, b"\xff") == EXCEEDS
            assert refusal(node, mapping, 0, b"\0") == 0
            for sub, index in enumerate((0x607A, 0x60FF, 0x60B0), 1):
                entry = struct.pack("<I", profile(index, axis) << 16 | 32)
                assert refusal(node, mapping, sub, entry) == 0
            assert refusal(node, mapping, 0, b"\3") == EXCEEDS, "twelve bytes"
            assert refusal(node, mapping, 0, b"\2") == 0
            assert upload(node, mapping, 0) == b"\2"


@pytest.mark.parametrize("direction", ["rpdo", "tpdo"])
def test_an_active_pdo_is_not_changed(node: canopen.RemoteNode, direction: str) -> None:
    pdos = getattr(node, direction)
    for position, (axis, number) in enumerate(SOME):
        index = (0x1400 if direction == "rpdo" else 0x1800) + number - 1
        set_up(pdos[number], transmit_cob_id(position), [profile(0x607A, axis)], 0xFF)
        entry = struct.pack("<I", profile(0x60FF, axis) << 16 | 32)
        kept = [upload(node, index + 0x200, sub) for sub in range(4)]
        for sub, data in ((0, b"\0"), (0, b"\2"), (1, entry), (2, entry)):
            assert refusal(node, index + 0x200, sub, data) == ACTIVE, (hex(index), sub)
        assert [upload(node, index + 0x200, sub) for sub in range(4)] == kept
        moved = struct.pack("<I", 0x40000000 | transmit_cob_id(position) + 0x100)
        assert refusal(node, index, 1, moved) == ACTIVE
        if direction == "tpdo":
            assert refusal(node, index, 3, struct.pack("<H", 10)) == ACTIVE  # CiA 301 §7.5.2.37
        # Inactive, but its number of entries not yet 0.
        assert refusal(node, index, 1, struct.pack("<I", 0xC0000000 | transmit_cob_id(position))) == 0
        assert refusal(node, index + 0x200, 1, entry) != 0
        assert refusal(node, index + 0x200, 0, b"\0") == 0
        assert refusal(node, index + 0x200, 1, entry) == 0


def test_only_what_the_manual_calls_mappable_is_mapped(node: canopen.RemoteNode) -> None:
    for axis, number in SOME:
        for mapping in (0x1600 + number - 1, 0x1A00 + number - 1):
            communication = struct.pack("<I", 0xC0000000 | 0x1F0)
            assert refusal(node, mapping - 0x200, 1, communication) == 0
            assert refusal(node, mapping, 0, b"\0") == 0
            for index, sub, bits in UNMAPPABLE:
                moved = profile(index, axis) if index >= 0x6000 else manufacturer(index, axis)
                entry = struct.pack("<I", moved << 16 | sub << 8 | bits)
                assert refusal(node, mapping, 1, entry) == NOT_MAPPABLE, (hex(mapping), hex(moved))
            wrong_length = struct.pack("<I", profile(0x6040, axis) << 16 | 8)
            assert refusal(node, mapping, 1, wrong_length) == NOT_MAPPABLE
            assert refusal(node, mapping, 1, struct.pack("<I", 0x5FFF0020)) == NO_OBJECT
            assert refusal(node, mapping, 1, bytes(4)) == 0
            assert refusal(node, mapping, 0, b"\1") == NOT_MAPPABLE, "there is no first entry"
            ro = struct.pack("<I", profile(0x6041, axis) << 16 | 16)
            assert refusal(node, mapping, 1, ro) == (NOT_MAPPABLE if mapping < 0x1A00 else 0)


def test_identifiers_and_transmission_types_that_can_not_be(node: canopen.RemoteNode) -> None:
    for _, number in SOME:
        for index in (0x1400 + number - 1, 0x1800 + number - 1):
            assert refusal(node, index, 1, struct.pack("<I", 0xC0000000 | 0x1F0)) == 0
            for cob_id in (
                0x000001F0,  # RTR allowed
                0x800001F0,
                0x600001F0,  # 29 bits
                0x40000000 | 0x800,
                0x40000000,  # NMT
                0x40000601,  # SDO
                0x40000581,
                0x40000701,  # heartbeat
                0x400007E5,  # LSS
            ):
                assert refusal(node, index, 1, struct.pack("<I", cob_id)) == NOT_ALLOWED, hex(cob_id)
            for kind in (1, 2, 240, 254, 255):
                assert refusal(node, index, 2, bytes((kind,))) == 0
            assert refusal(node, index, 2, b"\0") == TOO_LOW
            for kind in (241, 252, 253):
                assert refusal(node, index, 2, bytes((kind,))) == NOT_ALLOWED
            assert upload(node, index, 2) == b"\xff"


def test_a_pdo_of_another_length_or_with_a_bad_value_is_not_taken_and_reported(
    node: canopen.RemoteNode,
) -> None:
    node.nmt.state = "OPERATIONAL"
    for position, (axis, number) in enumerate(NUMBERS):
        pdo, target, mode = node.rpdo[number], profile(0x607A, axis), profile(0x6060, axis)
        set_up(pdo, receive_cob_id(position), [target, mode], 0xFF)
        cases = [
            (struct.pack("<i", 5), 0x8210),
            (struct.pack("<ibb", 5, 3, 0), 0x8220),
            (struct.pack("<ib", 5, 2), 0x6320),  # mode 2 is none of the module's
        ]
        for data, code in cases:
            node.emcy.reset()
            node.network.send_message(receive_cob_id(position), data)
            wait(lambda: bool(node.emcy.log), 2, f"EMCY {code:04X}h")
            error = node.emcy.log[0]
            assert (error.code, error.data[1:]) == (code, bytes((255, 0, 0, 0)))
            assert (objects(node)[target].raw, objects(node)[mode].raw) == (0, 0)


def test_pdo_records_are_forgotten_at_a_reset(node: canopen.RemoteNode) -> None:
    for position, (axis, number) in enumerate(NUMBERS):
        set_up(node.tpdo[number], transmit_cob_id(position), [profile(0x60FD, axis)], 7)
    for command in ("RESET COMMUNICATION", "RESET"):
        booted: list[int] = []
        node.nmt.add_heartbeat_callback(booted.append)
        node.nmt.state = command
        wait(lambda booted=booted: 0 in booted)
        assert upload(node, 0x1A00, 1) == struct.pack("<I", 0x60410010)
        assert upload(node, 0x1A40, 1) == struct.pack("<I", 0x68410010)
        assert upload(node, 0x1880, 1) == struct.pack("<I", 0xC0000000)
