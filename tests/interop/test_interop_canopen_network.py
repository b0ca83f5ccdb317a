"""The module on the network, by PyPI canopen: NMT, heartbeats, EMCY, SYNC, store and restore, LSS.

The module runs in another process; each test leaves it as it came from the factory.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator

import canopen
import pytest
from canopen.lss import LssError, LssMaster
from canopen_kit import (
    AXES,
    PATIENCE,
    Axis,
    connected,
    join,
    objects,
    read_refusal,
    refusal,
    reset,
    simulator,
    upload,
    wait,
)

pytestmark = pytest.mark.process

MASTER = 126
PRE_OPERATIONAL, OPERATIONAL, STOPPED = 127, 5, 4


@pytest.fixture(scope="module")
def bus() -> Iterator[canopen.RemoteNode]:
    with simulator() as port, connected(port) as network:
        yield join(network)


@pytest.fixture
def node(bus: canopen.RemoteNode) -> canopen.RemoteNode:
    reset(bus)
    bus.emcy.reset()
    return bus


class States:
    """NMT states by heartbeat and boot-up, in the order of their coming."""

    def __init__(self, node: canopen.RemoteNode) -> None:
        self.seen: list[int] = []
        node.nmt.add_heartbeat_callback(self.seen.append)

    def wait(self, state: int) -> None:
        wait(lambda: state in self.seen, 5, f"state {state}, seen {self.seen}")


def silent(node: canopen.RemoteNode) -> bool:
    """Whether the node leaves an SDO unanswered."""
    node.sdo.RESPONSE_TIMEOUT = 0.1
    try:
        read_refusal(node, 0x1000, 0)
    except canopen.SdoCommunicationError:
        return True
    finally:
        node.sdo.RESPONSE_TIMEOUT = PATIENCE
    return False


def heartbeat(node: canopen.RemoteNode) -> None:
    """Of the master."""
    node.network.send_message(0x700 + MASTER, bytes([5]))


def watch(node: canopen.RemoteNode, milliseconds: int) -> None:
    assert refusal(node, 0x1016, 1, struct.pack("<I", MASTER << 16 | milliseconds)) == 0


# --- NMT and heartbeats ---


def test_each_nmt_command_leads_to_its_state(node: canopen.RemoteNode) -> None:
    objects(node)[0x1017].raw = 10
    for command, state in (
        ("OPERATIONAL", OPERATIONAL),
        ("PRE-OPERATIONAL", PRE_OPERATIONAL),
        ("STOPPED", STOPPED),
        ("PRE-OPERATIONAL", PRE_OPERATIONAL),
        ("STOPPED", STOPPED),
        ("OPERATIONAL", OPERATIONAL),
    ):
        node.nmt.state = command
        states = States(node)
        wait(lambda states=states, state=state: states.seen[-2:] == [state] * 2)
        if state == STOPPED:
            assert silent(node), "no SDO in Stopped"
        else:
            assert upload(node, 0x1000)
    for command in ("RESET COMMUNICATION", "RESET"):
        objects(node)[0x1017].raw = 10
        states = States(node)
        node.nmt.state = command
        states.wait(0)
        time.sleep(0.03)
        after = states.seen[states.seen.index(0) :]
        assert after == [0], "the heartbeat is off after a reset, as 1017h is 0"
        assert objects(node)[0x1017].raw == 0


def test_a_command_to_all_nodes_counts_and_one_to_another_node_does_not(node: canopen.RemoteNode) -> None:
    objects(node)[0x1017].raw = 10
    node.network.nmt.send_command(1)
    States(node).wait(OPERATIONAL)
    node.network.send_message(0, bytes([2, 7]))
    time.sleep(0.03)
    states = States(node)
    wait(lambda: len(states.seen) >= 3)
    assert set(states.seen) == {OPERATIONAL}


def test_reset_communication_keeps_what_is_not_communication(node: canopen.RemoteNode) -> None:
    objects(node)[0x2012].raw = 77
    objects(node)[0x1015].raw = 5
    states = States(node)
    node.nmt.state = "RESET COMMUNICATION"
    states.wait(0)
    assert (objects(node)[0x2012].raw, objects(node)[0x1015].raw) == (77, 0)
    reset(node)
    assert objects(node)[0x2012].raw == 0


def test_the_heartbeat_keeps_its_period(node: canopen.RemoteNode) -> None:
    times: list[float] = []
    node.nmt.add_heartbeat_callback(lambda _: times.append(time.monotonic()))
    objects(node)[0x1017].raw = 20
    wait(lambda: len(times) >= 11)
    objects(node)[0x1017].raw = 0
    mean = (times[10] - times[0]) / 10
    assert 0.01 < mean < 0.1
    upload(node, 0x1000)
    count = len(times)
    time.sleep(0.05)
    assert len(times) == count


def test_nmt_stopped_sends_enabled_axes_to_fault_and_no_others(node: canopen.RemoteNode) -> None:
    Axis(node, 1).enable(1)
    Axis(node, 2).write(0x6040, 6, "H")
    node.nmt.state = "STOPPED"
    node.nmt.state = "PRE-OPERATIONAL"
    assert [Axis(node, axis).status & 0x6F & (0x6F if axis == 2 else 0x4F) for axis in AXES] == [
        0x40,
        0x08,
        0x21,
    ]


# --- the watch over the master (§3.1.11, §3.1.14) ---


def test_a_lost_heartbeat_is_reported_and_stops_the_node_and_its_axes(node: canopen.RemoteNode) -> None:
    objects(node)[0x1017].raw = 10
    assert objects(node)[0x1029][1].raw == 0
    watch(node, 60)
    node.nmt.state = "OPERATIONAL"
    axis = Axis(node, 0)
    axis.enable(3)
    time.sleep(0.15)
    assert node.emcy.log == [], "not watched before the first heartbeat"
    for _ in range(5):
        heartbeat(node)
        time.sleep(0.02)
    states = States(node)
    states.wait(STOPPED)
    (error,) = node.emcy.log
    assert (error.code, error.register & 0x11, error.data) == (0x8130, 0x11, bytes((0, 255, 0, 0, 0)))
    node.nmt.state = "PRE-OPERATIONAL"
    assert axis.status & 0x4F == 0x08, "NMT Stopped means FAULT (§2.2)"


def test_1029h_1_keeps_the_node_running(node: canopen.RemoteNode) -> None:
    objects(node)[0x1017].raw = 10
    objects(node)[0x1029][1].raw = 1
    watch(node, 50)
    node.nmt.state = "OPERATIONAL"
    axis = Axis(node, 2)
    axis.enable(1)
    heartbeat(node)
    wait(lambda: bool(node.emcy.log))
    assert node.emcy.log[0].code == 0x8130
    states = States(node)
    wait(lambda: len(states.seen) >= 3)
    assert set(states.seen) == {OPERATIONAL}
    assert axis.status & 0x6F == 0x27
    assert objects(node)[0x1001].raw & 0x10
    heartbeat(node)
    wait(lambda: objects(node)[0x1001].raw == 0)


def test_the_reaction_is_one_of_operational_only(node: canopen.RemoteNode) -> None:
    objects(node)[0x1017].raw = 10
    watch(node, 50)
    heartbeat(node)
    wait(lambda: bool(node.emcy.log))
    states = States(node)
    wait(lambda: len(states.seen) >= 3)
    assert set(states.seen) == {PRE_OPERATIONAL}


def test_an_application_error_changes_the_nmt_state_only_if_1029h_2_says_so(node: canopen.RemoteNode) -> None:
    objects(node)[0x1017].raw = 10
    for value, state in ((1, OPERATIONAL), (0, STOPPED)):
        objects(node)[0x1029][2].raw = value
        node.nmt.state = "OPERATIONAL"
        axis = Axis(node, 0)
        pass_software_limit(axis)
        states = States(node)
        wait(lambda states=states, state=state: states.seen[2:][-2:] == [state] * 2)
        node.nmt.state = "PRE-OPERATIONAL"
        assert axis.status & 0x4F == 0x08
        axis.write(0x60FF, 0, "i")
        axis.write(0x607D, -(2**31), "i", 1)
        axis.disable()
        node.emcy.reset()


def pass_software_limit(axis: Axis) -> None:
    """A fault that can be had over the bus alone: a software limit is passed in pv (EMCY FF01h)."""
    axis.ramps(100_000, 10_000_000)
    axis.write(0x607D, -1000 + axis.position, "i", 1)
    axis.enable(3)
    axis.write(0x60FF, -100_000, "i")
    wait(lambda: bool(axis.node.emcy.log), 5, "EMCY FF01h")


# --- EMCY on the wire ---


@pytest.mark.parametrize("number", AXES)
def test_an_error_of_an_axis_its_reset_and_the_register_in_between(
    node: canopen.RemoteNode, number: int
) -> None:
    axis = Axis(node, number)
    pass_software_limit(axis)
    (error,) = node.emcy.active
    assert (error.code, error.data) == (0xFF01, bytes((2, number, 0, 0, 0)))
    assert error.register == objects(node)[0x1001].raw == 0x81
    axis.wait(0x4F, 0x08)
    axis.disable()
    wait(lambda: node.emcy.active == [], 2, "0000h")
    assert (node.emcy.log[-1].register, node.emcy.log[-1].data) == (0, bytes((0, number, 0, 0, 0)))
    assert objects(node)[0x1001].raw == 0


def test_the_inhibit_time_and_the_identifier_of_emcy(node: canopen.RemoteNode) -> None:
    times: list[float] = []
    node.emcy.callbacks[:] = [lambda error: times.append(error.timestamp)]
    objects(node)[0x1015].raw = 500  # 50 ms
    node.nmt.state = "OPERATIONAL"
    for _ in range(4):
        node.network.send_message(0x201, bytes([1]))  # too short for RPDO 1
    wait(lambda: len(times) == 4)
    assert times[3] - times[0] > 0.1, "three times 50 ms, as far as a busy machine stamps them in time"
    node.emcy.callbacks.clear()
    other: list[bytes] = []
    node.network.subscribe(0x0B1, lambda _id, data, _time: other.append(bytes(data)))
    objects(node)[0x1014].raw = 0xB1
    node.network.send_message(0x201, bytes([1]))
    wait(lambda: len(other) == 1)
    assert other[0][:2] == b"\x10\x82"
    objects(node)[0x1014].raw = 0x800000B1
    node.network.send_message(0x201, bytes([1]))
    upload(node, 0x1000)
    time.sleep(0.1)
    assert (len(other), len(times)) == (1, 4), "bit 31: no EMCY"


def test_sync_is_taken_where_1005h_says(node: canopen.RemoteNode) -> None:
    got: list[bytes] = []
    node.network.subscribe(
        0x381, lambda _id, data, _time: got.append(bytes(data))
    )  # TPDO 3: type 1 by default
    node.nmt.state = "OPERATIONAL"
    objects(node)[0x1005].raw = 0x90
    node.network.sync.transmit()
    upload(node, 0x1000)
    assert got == []
    node.network.send_message(0x90, b"")
    wait(lambda: len(got) == 1)
    assert got[0] == upload(node, 0x6041) + upload(node, 0x6064)
    node.network.send_message(0x90, bytes([1]))
    wait(lambda: len(got) == 2, 2, "SYNC with a counter")


# --- store and restore (§3.1.7, §3.1.8, §4.2.62-64) ---


def test_parameters_are_kept_by_group_and_restored_by_group(node: canopen.RemoteNode) -> None:
    def values() -> list[int]:
        return [Axis(node, axis).read(0x2012, "I") for axis in AXES]

    def write() -> None:
        for axis in AXES:
            Axis(node, axis).write(0x2012, 100 + axis, "I")

    try:
        write()
        reset(node)
        assert values() == [0, 0, 0], "nothing was saved"
        for axis in AXES:
            write()
            node.store(4 + axis)
            reset(node)
            assert values() == [100 + n if n <= axis else 0 for n in AXES]
        Axis(node, 1).write(0x607A, 5, "i")
        node.store()
        node.restore(5)
        assert values() == [100, 101, 102], "a restore counts from the next reset on"
        reset(node)
        assert values() == [100, 0, 102]
        assert Axis(node, 1).read(0x607A, "i") == 0, "set points are not kept"
        node.restore(2)
        reset(node)
        assert values() == [100, 0, 102], "no function"
        node.restore()
        reset(node)
        assert values() == [0, 0, 0]
    finally:
        node.restore()


def test_bit_rate_and_node_id_by_their_objects(node: canopen.RemoteNode) -> None:
    network = node.network
    try:
        objects(node)[0x2704].raw = 500
        objects(node)[0x2705].raw = 9
        assert (objects(node)[0x2707].raw, objects(node)[0x2708].raw) == (1000, 1), "not before a reset"
        reset(node)
        assert (objects(node)[0x2704].raw, objects(node)[0x2705].raw) == (1000, 1), "not without saving"
        objects(node)[0x2704].raw = 500
        objects(node)[0x2705].raw = 9
        node.sdo.download(0x2706, 1, b"save")
        objects(node)[0x2704].raw = 20  # not saved
        nine = join(network, 9)
        states = States(nine)
        node.nmt.state = "RESET"
        states.wait(0)
        assert silent(node)
        assert [objects(nine)[index].raw for index in (0x2704, 0x2705, 0x2707, 0x2708)] == [500, 9, 500, 9]
        assert objects(nine)[0x1014].raw == 0x89
        assert objects(nine)[0x1800][1].raw == 0x40000189
        assert objects(nine)[0x1400][1].raw == 0x40000209
    finally:
        back = network.nodes.get(9) or join(network, 9)
        objects(back)[0x2704].raw = 1000
        objects(back)[0x2705].raw = 1
        back.sdo.download(0x2706, 1, b"save")
        states = States(node)
        back.nmt.state = "RESET"
        states.wait(0)
        del network[9]


# --- LSS (§2.3, CiA 305) ---


def lss_in_configuration(network: canopen.Network) -> LssMaster:
    network.lss.send_switch_state_global(network.lss.CONFIGURATION_STATE)
    return network.lss


def test_lss_tells_who_the_module_is(node: canopen.RemoteNode) -> None:
    lss = lss_in_configuration(node.network)
    identity = [lss.inquire_lss_address(0x5A + part) for part in range(4)]
    assert identity == [objects(node)[0x1018][sub].raw for sub in (1, 2, 3, 4)]
    assert identity[:2] == [0x286, 3216]
    assert lss.inquire_node_id() == 1
    lss.send_switch_state_global(lss.WAITING_STATE)
    lss.RESPONSE_TIMEOUT = 0.1
    with pytest.raises(LssError):
        lss.inquire_node_id()
    lss.RESPONSE_TIMEOUT = 0.5


def test_lss_selects_by_the_whole_identity_only(node: canopen.RemoteNode) -> None:
    lss = node.network.lss
    vendor, product, revision, serial = (objects(node)[0x1018][sub].raw for sub in (1, 2, 3, 4))
    lss.RESPONSE_TIMEOUT = 0.1
    with pytest.raises(LssError):
        lss.send_switch_state_selective(vendor, product, revision, serial + 1)
    lss.RESPONSE_TIMEOUT = 0.5
    assert lss.send_switch_state_selective(vendor, product, revision, serial)
    assert lss.inquire_node_id() == 1
    lss.send_switch_state_global(lss.WAITING_STATE)


def test_lss_refuses_what_can_not_be(node: canopen.RemoteNode) -> None:
    lss = lss_in_configuration(node.network)
    for wrong in (0, 128, 254):
        with pytest.raises(LssError):
            lss.configure_node_id(wrong)
    for wrong in (8, 9, 10, 200):  # 10 kbit/s, automatic, none
        with pytest.raises(LssError):
            lss.configure_bit_timing(wrong)
    for index in (0, 1, 2, 3, 4, 6, 7):
        lss.configure_bit_timing(index)
    lss.configure_bit_timing(0)
    lss.send_switch_state_global(lss.WAITING_STATE)


def test_lss_gives_a_node_id_and_a_bit_rate_that_hold_over_resets(node: canopen.RemoteNode) -> None:
    network = node.network
    lss = lss_in_configuration(network)
    try:
        lss.configure_node_id(33)
        lss.configure_bit_timing(3)  # 250 kbit/s
        lss.store_configuration()
        lss.send_switch_state_global(lss.WAITING_STATE)
        assert objects(node)[0x2708].raw == 1, "the old one until a reset"
        renamed = join(network, 33)
        for command in (0x82, 0x81):
            states = States(renamed)
            network.nmt.send_command(command)
            states.wait(0)
            assert objects(renamed)[0x2708].raw == 33
        assert objects(renamed)[0x2707].raw == 250
        assert silent(node)
    finally:
        lss_in_configuration(network)
        lss.configure_node_id(1)
        lss.configure_bit_timing(0)
        lss.store_configuration()
        lss.send_switch_state_global(lss.WAITING_STATE)
        states = States(node)
        network.nmt.send_command(0x81)
        states.wait(0)
        del network[33]


def test_an_unconfigured_module_is_reached_by_lss_only(node: canopen.RemoteNode) -> None:
    network = node.network
    revision, serial = objects(node)[0x1018][3].raw, objects(node)[0x1018][4].raw
    objects(node)[0x2705].raw = 255
    node.sdo.download(0x2706, 1, b"save")
    states = States(node)
    node.nmt.state = "RESET"
    time.sleep(0.05)
    assert silent(node)
    assert states.seen == [], "no boot-up without a node ID"
    assert network.lss.send_switch_state_selective(0x286, 3216, revision, serial)
    assert network.lss.inquire_node_id() == 255
    network.lss.configure_node_id(1)
    network.lss.store_configuration()
    network.lss.send_switch_state_global(network.lss.WAITING_STATE)
    states.wait(0)
    assert objects(node)[0x1018][4].raw == serial
    assert objects(node)[0x2705].raw == 1
