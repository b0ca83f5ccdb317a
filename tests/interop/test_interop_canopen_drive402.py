"""Motion by PyPI canopen: its BaseNode402 on axis 0, and plain scripts on all three axes; csp, csv, homing.

The module runs in another process, on its default travel: limit switches from +-1,000,000 microsteps
outwards, a home switch from 100,000 to 110,000, an index pulse at 12,800 and every 51,200 from there.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator

import canopen
import pytest
from canopen.pdo import PdoMap
from canopen.profiles.p402 import BaseNode402
from canopen_kit import AXES, Axis, connected, join, join_as, objects, refusal, reset, simulator, wait

pytestmark = pytest.mark.process

NEGATIVE_LIMIT, POSITIVE_LIMIT, HOME_SWITCH = 1 << 0, 1 << 1, 1 << 2  # of 60FDh, by CiA 402
FOUND, STOPPED = 0x1400, 0x0400
ENABLED = 0x27


@pytest.fixture(scope="module")
def bus() -> Iterator[canopen.RemoteNode]:
    with simulator() as port, connected(port) as network:
        yield join(network)


@pytest.fixture
def node(bus: canopen.RemoteNode) -> canopen.RemoteNode:
    reset(bus)
    bus.emcy.reset()
    bus.nmt.state = "OPERATIONAL"
    return bus


# --- BaseNode402: axis 0 only ---


@pytest.fixture
def drive(node: canopen.RemoteNode) -> Iterator[BaseNode402]:
    """On canopen's own terms: state and mode by the default PDOs, which it expects to be periodic."""
    axis = Axis(node, 0)
    axis.ramps(400_000, 4_000_000)
    network = node.network
    del network[1]
    drive = join_as(BaseNode402, network, 1)
    drive.nmt.state = "PRE-OPERATIONAL"
    for index in (0x1800, 0x1801):
        objects(drive)[index][5].raw = 20
    drive.setup_402_state_machine()
    drive.nmt.state = "OPERATIONAL"
    drive.check_statusword(2)
    yield drive
    del network[1]
    network.add_node(node)


def statusword(drive: BaseNode402) -> int:
    """The last that came; canopen gives it a type of its own only by what the EDS says."""
    word = drive.statusword
    assert isinstance(word, int)
    return word


def test_base_node_402_walks_through_the_states(drive: BaseNode402) -> None:
    wait(lambda: drive.state == "SWITCH ON DISABLED")
    for state in (
        "READY TO SWITCH ON",
        "SWITCHED ON",
        "OPERATION ENABLED",
        "SWITCHED ON",
        "READY TO SWITCH ON",
        "OPERATION ENABLED",
        "SWITCH ON DISABLED",
    ):
        drive.state = state
        assert drive.state == state
    objects(drive)[0x605A].raw = 6  # so that it stays, as canopen expects
    drive.state = "OPERATION ENABLED"
    drive.state = "QUICK STOP ACTIVE"
    assert drive.state == "QUICK STOP ACTIVE"
    drive.state = "OPERATION ENABLED"


def test_base_node_402_switches_modes(drive: BaseNode402) -> None:
    drive.state = "SWITCH ON DISABLED"
    modes = ["PROFILED POSITION", "PROFILED VELOCITY", "HOMING", "CYCLIC SYNCHRONOUS POSITION"]
    modes += ["CYCLIC SYNCHRONOUS VELOCITY", "NO MODE"]
    for mode in modes:
        drive.op_mode = mode
        assert drive.op_mode == mode
    for mode in ("VELOCITY", "PROFILED TORQUE", "INTERPOLATED POSITION", "CYCLIC SYNCHRONOUS TORQUE"):
        assert not drive.is_op_mode_supported(mode)


def test_base_node_402_moves_in_pp(drive: BaseNode402) -> None:
    drive.op_mode = "PROFILED POSITION"
    drive.state = "OPERATION ENABLED"
    for target in (40_000, -10_000):
        objects(drive)[0x607A].raw = target
        drive.controlword = 0x1F
        wait(lambda: bool(statusword(drive) & 0x1000))
        drive.controlword = 0x0F
        wait(lambda: statusword(drive) & 0x1400 == 0x0400)
        assert objects(drive)[0x6064].raw == target
    objects(drive)[0x607A].raw = 500
    drive.controlword = 0x5F  # relative
    drive.controlword = 0x4F
    wait(lambda: objects(drive)[0x6064].raw == -9_500)


def test_base_node_402_runs_in_pv(drive: BaseNode402) -> None:
    drive.op_mode = "PROFILED VELOCITY"
    drive.state = "OPERATION ENABLED"
    objects(drive)[0x60FF].raw = -200_000
    wait(lambda: objects(drive)[0x606C].raw == -200_000)
    wait(lambda: bool(statusword(drive) & 0x0400))
    objects(drive)[0x60FF].raw = 0
    wait(lambda: objects(drive)[0x606C].raw == 0)
    assert drive.state == "OPERATION ENABLED"
    assert objects(drive)[0x6064].raw < 0


def test_base_node_402_homes(drive: BaseNode402) -> None:
    objects(drive)[0x6098].raw = 19
    objects(drive)[0x6099][1].raw = 1_000_000
    objects(drive)[0x6099][2].raw = 400_000
    objects(drive)[0x609A].raw = 100_000_000
    assert drive.homing(timeout=10)
    assert drive.is_homed()
    assert objects(drive)[0x6064].raw == 0


# --- plain scripts ---

DISABLED, READY, SWITCHED_ON, QUICK, FAULT = 0x40, 0x21, 0x23, 0x07, 0x08
WAY_TO = {DISABLED: (), READY: (6,), SWITCHED_ON: (6, 7), ENABLED: (6, 7, 15), QUICK: (6, 7, 15, 2)}
# Table 228, typed by hand: what each command does in each state; what is left out leaves the state alone.
# With bit 7 set a controlword is no other command, and a fault reset counts in FAULT only.
COMMANDS = (0, 2, 6, 7, 15, 0x80)
OUTCOMES = {
    DISABLED: {6: READY},
    READY: {0: DISABLED, 2: DISABLED, 7: SWITCHED_ON, 15: ENABLED},
    SWITCHED_ON: {0: DISABLED, 2: DISABLED, 6: READY, 15: ENABLED},
    ENABLED: {0: DISABLED, 2: QUICK, 6: READY, 7: SWITCHED_ON},
    QUICK: {0: DISABLED, 15: ENABLED},
    FAULT: {0x80: DISABLED},
}


def state_of(axis: Axis) -> int:
    status = axis.status
    return status & 0x4F if status & 0x4F in (DISABLED, FAULT) else status & 0x6F


def test_every_command_in_every_state(node: canopen.RemoteNode) -> None:
    wrong = []
    for number, (state, outcomes) in enumerate(OUTCOMES.items()):
        axis = Axis(node, number % 3)
        axis.write(0x605A, 6, "h")
        for command in COMMANDS:
            axis.control(0x80, 0)
            if state == FAULT:
                axis.control(*WAY_TO[ENABLED])
                node.nmt.state = "STOPPED"
                node.nmt.state = "OPERATIONAL"
            else:
                axis.control(*WAY_TO[state])
            assert state_of(axis) == state
            axis.control(command)
            expected = outcomes.get(command, state)
            if state_of(axis) != expected:
                wrong.append((hex(state), hex(command), hex(state_of(axis)), hex(expected)))
    assert wrong == []


def test_a_fault_is_reset_by_the_rising_edge_only(node: canopen.RemoteNode) -> None:
    axis = Axis(node, 1)
    axis.enable(1)
    axis.control(0x8F)
    node.nmt.state = "STOPPED"
    node.nmt.state = "OPERATIONAL"
    axis.control(0x80)
    assert state_of(axis) == FAULT, "the bit was set before"
    axis.control(0, 0x80)
    assert state_of(axis) == DISABLED


def test_a_script_moves_three_axes_at_once_by_pdo(node: canopen.RemoteNode) -> None:
    node.tpdo.read()
    node.rpdo.read()
    commands, reports = [], []
    for number in AXES:
        axis, base = Axis(node, number), 0x800 * number
        axis.ramps(300_000, 3_000_000)
        axis.write(0x6060, 1, "b")
        command, report = node.rpdo[64 * number + 3], node.tpdo[64 * number + 3]
        for pdo, cob_id, indices in ((command, 0x210, (0x6040, 0x607A)), (report, 0x190, (0x6041, 0x6064))):
            pdo.clear()
            for index in indices:
                pdo.add_variable(index + base)
            pdo.cob_id, pdo.trans_type, pdo.enabled = cob_id + number, 255, True
            pdo.save()
        commands.append(command)
        reports.append(report)

    def send(word: int, targets: tuple[int, int, int]) -> None:
        for command, target in zip(commands, targets, strict=True):
            command[0].raw, command[1].raw = word, target
            command.transmit()

    def all_have(mask: int, value: int) -> bool:
        return all(len(report.data) == 6 and report[0].raw & mask == value for report in reports)

    for word, state in ((6, 0x21), (7, 0x23), (15, ENABLED)):
        send(word, (0, 0, 0))
        wait(lambda state=state: all_have(0x6F, state), 5, f"state {state:02X}h")
    for targets in ((60_000, -50_000, 40_000), (-1, 2, -3)):
        send(15, targets)
        send(31, targets)
        send(15, targets)
        wait(lambda targets=targets: [report[1].raw for report in reports] == list(targets))
        wait(lambda: all_have(0x5400, 0x0400), 5, "target reached, motor at rest")


@pytest.mark.parametrize("number", AXES)
def test_a_script_uses_the_options_of_pp(node: canopen.RemoteNode, number: int) -> None:
    axis = Axis(node, number)
    axis.ramps(500_000, 10_000_000)
    axis.enable(1)
    axis.move(10_000)
    # 60F2h: relative to the target before, to the demand, to the actual position: the same at rest.
    for option, expected in ((0, 11_000), (1, 12_000), (2, 13_000)):
        axis.write(0x60F2, option, "H")
        axis.write(0x607A, 1000, "i")
        axis.control(0x4F, 0x5F, 0x4F)
        axis.wait(0x1400, 0x0400)
        assert axis.position == expected
    # 607Dh: a target beyond is not driven to (§6.1.11); the home offset shifts the limits.
    axis.write(0x607C, 500, "i")
    axis.write(0x607D, 20_000, "i", 2)
    axis.write(0x607A, 100_000, "i")
    axis.control(15, 31, 15)
    axis.wait(0x4000, 0)
    assert axis.position <= 19_500
    # Halt ramps down and stays enabled (605Dh = 1); its end goes on.
    axis.write(0x607A, -150_000, "i")
    axis.control(15, 31, 15)
    axis.wait(0x4000, 0x4000)
    axis.control(0x010F)
    axis.wait(0x406F, ENABLED)
    assert -150_000 < axis.position < 19_500
    axis.control(0x000F)
    axis.wait(0x1400, 0x0400)
    assert axis.position == -150_000


@pytest.mark.parametrize(("option", "state"), [(1, 0x40), (2, 0x40), (5, 0x07), (6, 0x07)])
def test_quick_stop_ends_as_its_option_says(node: canopen.RemoteNode, option: int, state: int) -> None:
    axis = Axis(node, option % 3)
    axis.ramps(100_000, 2_000_000)
    axis.write(0x605A, option, "h")
    axis.enable(3)
    axis.write(0x60FF, 50_000, "i")
    axis.wait(0x0400, 0x0400)
    axis.control(2)
    axis.wait(0x4000 | (0x4F if state == 0x40 else 0x6F), state)
    assert axis.velocity == 0


def test_shutdown_disable_voltage_and_disable_operation_stop_the_motor(node: canopen.RemoteNode) -> None:
    for number, (word, state) in enumerate(((6, 0x21), (0, 0x40), (7, 0x23))):
        axis = Axis(node, number)
        axis.ramps(100_000, 5_000_000)
        axis.enable(3)
        axis.write(0x60FF, 80_000, "i")
        axis.wait(0x0400, 0x0400)
        axis.control(word)
        axis.wait(0x4000 | (0x4F if state == 0x40 else 0x6F), state)
        assert axis.velocity == 0


def test_mode_0_stops_the_motor_and_stays_enabled(node: canopen.RemoteNode) -> None:
    axis = Axis(node, 2)
    axis.ramps(100_000, 2_000_000)
    axis.enable(3)
    axis.write(0x60FF, -90_000, "i")
    axis.wait(0x4400, 0x4400)
    axis.write(0x6060, 0, "b")
    axis.wait(0x406F, ENABLED)
    wait(lambda: axis.read(0x6061, "b") == 0)
    assert axis.velocity == 0


# --- cyclic modes: a synchronous RPDO, and SYNC at the period of 60C2h ---


def cyclic(node: canopen.RemoteNode, axis: Axis, index: int, value: int, exponent: int) -> PdoMap:
    axis.write(0x60C2, value, "B", 1)
    axis.write(0x60C2, exponent, "b", 2)
    number = 64 * axis.number + 4
    node.rpdo[number].read()
    pdo = node.rpdo[number]
    pdo.clear()
    pdo.add_variable(axis.index(index))
    pdo.cob_id, pdo.trans_type, pdo.enabled = 0x220, 1, True
    pdo.save()
    return pdo


@pytest.mark.parametrize("number", AXES)
def test_csp_is_at_each_set_point_one_period_after_its_sync(node: canopen.RemoteNode, number: int) -> None:
    axis = Axis(node, number)
    pdo = cyclic(node, axis, 0x607A, 20, -3)
    axis.enable(8)
    assert axis.status & 0x2000 == 0
    for target in (1000, 3000, 2500, -4000, 0, 7):
        pdo[0].raw = target
        pdo.transmit()
        assert axis.position != target, "not before the SYNC"
        began = time.monotonic()
        node.network.sync.transmit()
        wait(lambda target=target: axis.position == target, 2)
        assert time.monotonic() - began > 0.015
        assert axis.status & 0x1000, "bit 12: the target position is used (§9.1.2)"
    axis.write(0x60B0, 100, "i")
    wait(lambda: axis.position == 107, 2, "60B0h is added to the target")


def test_csp_runs_straight_at_the_speed_that_60c2h_gives(node: canopen.RemoteNode) -> None:
    axis = Axis(node, 1)
    pdo = cyclic(node, axis, 0x607A, 5, -1)
    axis.enable(8)
    pdo[0].raw = 25_000
    pdo.transmit()
    node.network.sync.transmit()
    wait(lambda: axis.velocity == 50_000)
    assert axis.status & 0x4000
    wait(lambda: axis.position == 25_000, 2)
    assert axis.velocity == 0


@pytest.mark.parametrize("number", AXES)
def test_csv_is_at_each_set_point_one_period_after_its_sync(node: canopen.RemoteNode, number: int) -> None:
    axis = Axis(node, number)
    pdo = cyclic(node, axis, 0x60FF, 6, -2)
    axis.enable(9)
    for target in (30_000, -20_000, 0):
        pdo[0].raw = target
        pdo.transmit()
        before = axis.velocity
        began = time.monotonic()
        node.network.sync.transmit()
        assert min(before, target) <= axis.velocity <= max(before, target)
        wait(lambda target=target: axis.velocity == target, 2)
        assert time.monotonic() - began > 0.05
        assert axis.status & 0x1000
    axis.write(0x60B1, 500, "i")
    wait(lambda: axis.velocity == 500, 2, "60B1h is added to the target")


def test_the_offsets_of_the_cyclic_modes_leave_pp_and_pv_alone(node: canopen.RemoteNode) -> None:
    axis = Axis(node, 0)
    axis.ramps(500_000, 10_000_000)
    axis.write(0x60B0, 1000, "i")
    axis.write(0x60B1, 1000, "i")
    axis.enable(1)
    axis.move(5000)
    axis.disable()
    axis.enable(3)
    axis.write(0x60FF, 20_000, "i")
    axis.wait(0x0400, 0x0400)
    assert axis.velocity == 20_000


# --- homing: all methods end where the manual says, seen from the switches ---


def homing(axis: Axis, method: int) -> None:
    """To the end of the method, as in §8.3 with the bits of table 304."""
    axis.write(0x6098, method, "b")
    axis.write(0x6060, 6, "b")
    wait(lambda: axis.read(0x6061, "b") == 6)
    axis.control(15, 31)
    axis.wait(FOUND, FOUND)
    axis.control(15)
    assert axis.position == axis.read(0x6062, "i") == axis.read(0x6063, "i") == 0
    assert axis.status & 0x6F == ENABLED


def edge(axis: Axis, position: int, outwards: int, switch: int) -> None:
    """The switch is active at a position, and not yet one microstep before."""
    axis.write(0x6060, 1, "b")
    axis.wait(0x0400, 0x0400)
    for target, active in ((position - outwards, False), (position, True)):
        axis.move(target)
        assert bool(axis.read(0x60FD, "I") & switch) == active, f"at {target}"
    axis.move(position - outwards)


@pytest.fixture
def homer(node: canopen.RemoteNode, request: pytest.FixtureRequest) -> Axis:
    """An enabled axis with fast ramps; one that stands on the lower edge of the home switch is position 0."""
    axis = Axis(node, request.param)
    axis.ramps(4_000_000, 400_000_000)
    axis.write(0x6099, 4_000_000, "I", 1)
    axis.write(0x6099, 400_000, "I", 2)
    axis.write(0x609A, 400_000_000, "I")
    axis.enable(6)
    return axis


# Method; where then a switch becomes active: at which position, in which direction, and which switch.
HOME_SWITCH_METHODS = [
    (19, 1, +1, HOME_SWITCH),
    (21, -1, -1, HOME_SWITCH),
    (3, 100_000 - 64_000, +1, HOME_SWITCH),
    (5, 110_000 - 115_200, -1, HOME_SWITCH),
]


@pytest.mark.parametrize(
    ("homer", "method", "position", "outwards", "switch"),
    [(number % 3, *row) for number, row in enumerate(HOME_SWITCH_METHODS)],
    indirect=["homer"],
)
def test_methods_with_the_home_switch_end_at_its_edge_or_the_next_index(
    homer: Axis, method: int, position: int, outwards: int, switch: int
) -> None:
    homing(homer, method)
    edge(homer, position, outwards, switch)
    homing(homer, method)
    edge(homer, position, outwards, switch)


# The limit switch is seen from within: its active side would be a fault outside of homing.
LIMIT_METHODS = [
    (17, -1, -1, NEGATIVE_LIMIT, 4),
    (18, +1, +1, POSITIVE_LIMIT, 3),
    (1, -1_000_000 + 960_000, -1, NEGATIVE_LIMIT, 4),
    (2, 1_000_000 - 985_600, +1, POSITIVE_LIMIT, 3),
]


@pytest.mark.parametrize(
    ("homer", "method", "position", "outwards", "switch", "cause"),
    [(number % 3, *row) for number, row in enumerate(LIMIT_METHODS)],
    indirect=["homer"],
)
def test_methods_with_a_limit_switch_end_at_its_edge_or_the_next_index(
    homer: Axis, method: int, position: int, outwards: int, switch: int, cause: int
) -> None:
    homing(homer, method)
    homer.write(0x6060, 1, "b")
    homer.wait(0x0400, 0x0400)
    homer.move(position - outwards)
    assert not homer.read(0x60FD, "I") & switch
    homer.write(0x607A, position, "i")
    homer.control(15, 31, 15)
    homer.wait(0x4F, 0x08)
    assert homer.position == position
    assert homer.read(0x60FD, "I") & switch
    wait(lambda: bool(homer.node.emcy.log))
    (error,) = homer.node.emcy.log
    assert (error.code, error.data) == (0xFF01, bytes((cause, homer.number, 0, 0, 0)))
    homer.disable()
    homer.enable(1)
    homer.move(position - 500_000 * outwards)  # the way back is free


@pytest.mark.parametrize(
    ("homer", "method", "position", "outwards"),
    [(1, 33, 100_000 - 64_000, +1), (2, 34, 110_000 - 115_200, -1)],
    indirect=["homer"],
)
def test_methods_with_the_index_alone_end_at_the_next_one(
    homer: Axis, method: int, position: int, outwards: int
) -> None:
    homing(homer, 19)
    homing(homer, method)
    edge(homer, position, outwards, HOME_SWITCH)


@pytest.mark.parametrize("number", AXES)
def test_method_35_needs_no_move_and_no_operation_enabled(node: canopen.RemoteNode, number: int) -> None:
    axis = Axis(node, number)
    axis.ramps(500_000, 10_000_000)
    axis.enable(1)
    axis.move(12_345)
    axis.disable()
    assert axis.position == 12_345
    axis.write(0x6060, 6, "b")
    axis.write(0x6098, 35, "b")
    axis.control(0x10)
    axis.wait(FOUND, FOUND)
    assert [axis.read(index, "i") for index in (0x6062, 0x6063, 0x6064)] == [0, 0, 0]
    assert axis.status & 0x4F == 0x40


@pytest.mark.parametrize("homer", [0], indirect=True)
def test_method_0_does_nothing(homer: Axis) -> None:
    homer.write(0x6098, 0, "b")
    homer.control(15, 31)
    time.sleep(0.05)
    assert homer.status & 0x5000 == 0
    assert homer.position == 0


@pytest.mark.parametrize("homer", [1], indirect=True)
def test_clearing_bit_4_stops_a_homing_and_bit_10_alone_says_so(homer: Axis) -> None:
    homer.write(0x6099, 50_000, "I", 1)
    homer.write(0x6098, 18, "b")
    homer.control(15, 31)
    homer.wait(0x4000, 0x4000)
    assert homer.status & FOUND == 0
    homer.control(15)
    homer.wait(0x4000 | FOUND, STOPPED)
    assert homer.velocity == 0
    assert homer.status & 0x6F == ENABLED


@pytest.mark.parametrize("homer", [2], indirect=True)
def test_the_zero_position_lies_the_home_offset_beyond_home(homer: Axis) -> None:
    homer.write(0x607C, 2500, "i")
    homer.write(0x6098, 19, "b")
    homer.control(15, 31)
    homer.wait(FOUND, FOUND)
    homer.control(15)
    assert homer.position == -2500
    assert homer.read(0x2100, "i") == 2500
    edge(homer, -2499, +1, HOME_SWITCH)


def test_homing_with_switches_of_another_polarity_needs_2005h(node: canopen.RemoteNode) -> None:
    axis = Axis(node, 0)
    assert axis.read(0x60FD, "I") & (NEGATIVE_LIMIT | POSITIVE_LIMIT | HOME_SWITCH) == 0
    for bit, switch in ((2, NEGATIVE_LIMIT), (3, POSITIVE_LIMIT), (5, HOME_SWITCH)):
        assert refusal(node, axis.index(0x2005), 0, struct.pack("<I", 1 << bit)) == 0
        assert axis.read(0x60FD, "I") & 7 == switch, "table 62: the switch is inverted"
