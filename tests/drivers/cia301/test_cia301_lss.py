"""LSS: golden frames, and the slave's states."""

from __future__ import annotations

import pytest

from drivers.cia301 import lss
from drivers.cia301.lss import (
    Command,
    Configured,
    Identified,
    Identity,
    IdentityRange,
    Inquired,
    Mode,
    NonConfigured,
    Selected,
)
from drivers.cia301.lss_slave import ActivateBitRate, LssSlave, StartNode, StoreConfiguration

MODULE = Identity(vendor=0x286, product=3216, revision=0x10004, serial=0x12345678)


def hx(text: str) -> bytes:
    return bytes.fromhex(text)


def slave_in_configuration(node: int = lss.UNCONFIGURED) -> LssSlave:
    slave = LssSlave(MODULE, node=node)
    assert slave.feed(lss.switch_global(Mode.CONFIGURATION)) == ([], [])
    assert slave.mode is Mode.CONFIGURATION
    return slave


@pytest.mark.parametrize(
    ("frame", "wire"),
    [
        (lss.switch_global(Mode.WAITING), "04 00 00 00 00 00 00 00"),
        (lss.switch_global(Mode.CONFIGURATION), "04 01 00 00 00 00 00 00"),
        (lss.configure_node_id(5), "11 05 00 00 00 00 00 00"),
        (lss.configure_bit_rate(250), "13 00 03 00 00 00 00 00"),
        (lss.configure_bit_rate(50), "13 00 06 00 00 00 00 00"),
        (lss.activate_bit_rate(1000), "15 E8 03 00 00 00 00 00"),
        (lss.store(), "17 00 00 00 00 00 00 00"),
        (lss.inquire(Command.INQUIRE_VENDOR), "5A 00 00 00 00 00 00 00"),
        (lss.inquire(Command.INQUIRE_NODE_ID), "5E 00 00 00 00 00 00 00"),
        (lss.identify_non_configured(), "4C 00 00 00 00 00 00 00"),
        (lss.fastscan(0x286, 31, 0, 1), "51 86 02 00 00 1F 00 01"),
    ],
)
def test_requests_have_these_bytes(frame: bytes, wire: str) -> None:
    assert frame == hx(wire)


def test_one_slave_is_selected_by_four_requests() -> None:
    assert [f.hex(" ").upper() for f in lss.switch_selective(MODULE)] == [
        "40 86 02 00 00 00 00 00",
        "41 90 0C 00 00 00 00 00",
        "42 04 00 01 00 00 00 00",
        "43 78 56 34 12 00 00 00",
    ]


@pytest.mark.parametrize(
    ("wire", "answer"),
    [
        ("44 00 00 00 00 00 00 00", Selected()),
        ("4F 00 00 00 00 00 00 00", Identified()),
        ("50 00 00 00 00 00 00 00", NonConfigured()),
        ("11 00 00 00 00 00 00 00", Configured(Command.CONFIGURE_NODE_ID, 0, 0)),
        ("13 01 00 00 00 00 00 00", Configured(Command.CONFIGURE_BIT_TIMING, 1, 0)),
        ("17 FF 07 00 00 00 00 00", Configured(Command.STORE, 255, 7)),
        ("5B 90 0C 00 00 00 00 00", Inquired(Command.INQUIRE_PRODUCT, 3216)),
        ("5E FF 00 00 00 00 00 00", Inquired(Command.INQUIRE_NODE_ID, 255)),
        ("04 01 00 00 00 00 00 00", None),
        ("44 00", None),
        ("", None),
    ],
)
def test_answers_are_told_apart(wire: str, answer: lss.Answer | None) -> None:
    assert lss.decode_answer(hx(wire)) == answer


def test_only_error_0_is_success() -> None:
    assert Configured(Command.STORE, 0, 0).succeeded
    assert not Configured(Command.STORE, 2, 0).succeeded


def test_requests_that_make_no_sense_are_refused() -> None:
    for node in (0, 128, 254):
        with pytest.raises(ValueError, match="node-ID"):
            lss.configure_node_id(node)
    with pytest.raises(ValueError, match="100 kbit/s"):
        lss.configure_bit_rate(100)
    with pytest.raises(ValueError, match="STORE"):
        lss.inquire(Command.STORE)


def test_a_slave_that_waits_obeys_no_configuration() -> None:
    slave = LssSlave(MODULE, node=1)
    for frame in (lss.configure_node_id(5), lss.store(), lss.inquire(Command.INQUIRE_NODE_ID)):
        assert slave.feed(frame) == ([], [])
    assert slave.pending_node == 1


def test_a_slave_is_selected_by_its_own_identity_only() -> None:
    slave = LssSlave(MODULE, node=1)
    other = MODULE._replace(serial=1)
    assert [slave.feed(f) for f in lss.switch_selective(other)] == [([], [])] * 4
    assert slave.mode is Mode.WAITING
    assert [slave.feed(f)[0] for f in lss.switch_selective(MODULE)] == [[], [], [], [hx("44" + "00" * 7)]]
    assert slave.mode is Mode.CONFIGURATION


def test_a_selection_with_a_part_missing_selects_nobody() -> None:
    slave = LssSlave(MODULE, node=1)
    vendor, _, revision, serial = lss.switch_selective(MODULE)
    assert [slave.feed(f) for f in (vendor, revision, serial)] == [([], [])] * 3
    assert slave.mode is Mode.WAITING


def test_a_node_without_an_id_starts_when_it_leaves_configuration() -> None:
    slave = slave_in_configuration()
    assert slave.feed(lss.configure_node_id(5)) == ([hx("11 00 00 00 00 00 00 00")], [])
    assert slave.node == lss.UNCONFIGURED
    assert slave.feed(lss.switch_global(Mode.WAITING)) == ([], [StartNode(5)])
    assert slave.node == 5


def test_a_node_with_an_id_takes_a_new_one_at_its_reset() -> None:
    slave = slave_in_configuration(node=1)
    slave.feed(lss.configure_node_id(5))
    assert slave.feed(lss.switch_global(Mode.WAITING)) == ([], [])
    assert slave.feed(lss.switch_global(Mode.CONFIGURATION)) == ([], [])
    assert slave.node == 1
    slave.reset()
    assert (slave.node, slave.mode) == (5, Mode.WAITING)


@pytest.mark.parametrize("node", [0, 128, 254])
def test_a_slave_refuses_what_is_no_node_id(node: int) -> None:
    slave = slave_in_configuration(node=1)
    assert slave.feed(bytes((0x11, node, 0, 0, 0, 0, 0, 0))) == ([hx("11 01 00 00 00 00 00 00")], [])
    assert slave.pending_node == 1


def test_a_slave_takes_bit_rates_of_table_0_only() -> None:
    slave = slave_in_configuration(node=1)
    assert slave.feed(lss.configure_bit_rate(250))[0] == [hx("13 00 00 00 00 00 00 00")]
    for refused in ("13 01 03 00 00 00 00 00", "13 00 05 00 00 00 00 00", "13 00 09 00 00 00 00 00"):
        assert slave.feed(hx(refused))[0] == [hx("13 01 00 00 00 00 00 00")]
    assert slave.feed(lss.activate_bit_rate(100)) == ([], [ActivateBitRate(250, 100)])


def test_storing_hands_node_id_and_bit_rate_to_the_owner() -> None:
    slave = slave_in_configuration(node=1)
    slave.feed(lss.configure_node_id(7))
    slave.feed(lss.configure_bit_rate(500))
    assert slave.feed(lss.store()) == ([hx("17 00 00 00 00 00 00 00")], [StoreConfiguration(7, 500)])
    slave.storage_works = False
    assert slave.feed(lss.store()) == ([hx("17 02 00 00 00 00 00 00")], [])


def test_a_slave_in_configuration_tells_who_it_is() -> None:
    slave = slave_in_configuration(node=1)
    commands = (*lss.INQUIRE_COMMANDS, Command.INQUIRE_NODE_ID)
    answers = [lss.decode_answer(slave.feed(lss.inquire(command))[0][0]) for command in commands]
    assert answers == [
        Inquired(command, value) for command, value in zip(commands, (*MODULE, 1), strict=True)
    ]


@pytest.mark.parametrize(
    ("span", "answered"),
    [
        (IdentityRange(0x286, 3216, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF), True),
        (IdentityRange(0x286, 3216, 0x10004, 0x10004, 0x12345678, 0x12345678), True),
        (IdentityRange(0x286, 1270, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF), False),
        (IdentityRange(0x286, 3216, 0, 0x10003, 0, 0xFFFFFFFF), False),
        (IdentityRange(0x286, 3216, 0, 0xFFFFFFFF, 0x12345679, 0xFFFFFFFF), False),
    ],
)
def test_a_slave_in_the_range_identifies_itself(span: IdentityRange, answered: bool) -> None:
    slave = LssSlave(MODULE, node=1)
    answers = [slave.feed(frame)[0] for frame in lss.identify(span)]
    assert answers == [[]] * 5 + [[hx("4F" + "00" * 7)] if answered else []]


def test_only_a_node_without_an_id_says_that_it_has_none() -> None:
    assert LssSlave(MODULE).feed(lss.identify_non_configured()) == ([hx("50" + "00" * 7)], [])
    assert LssSlave(MODULE, node=1).feed(lss.identify_non_configured()) == ([], [])


def test_a_fastscan_finds_the_identity_bit_by_bit() -> None:
    slave = LssSlave(MODULE)
    assert slave.feed(lss.fastscan(0, lss.FASTSCAN_RESET, 0, 0))[0]
    found: list[int] = []
    for sub in range(4):
        value = 0
        for bit in range(31, -1, -1):
            if not slave.feed(lss.fastscan(value, bit, sub, sub))[0]:
                value |= 1 << bit
        found.append(value)
        assert slave.feed(lss.fastscan(value, 0, sub, (sub + 1) % 4))[0]
    assert Identity(*found) == MODULE
    assert slave.mode is Mode.CONFIGURATION


def test_a_fastscan_passes_a_configured_node_by() -> None:
    assert LssSlave(MODULE, node=1).feed(lss.fastscan(0, lss.FASTSCAN_RESET, 0, 0)) == ([], [])
