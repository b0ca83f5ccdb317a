"""The simulated module on a hostile wire: no motor starts without the whole sequence of commands.

That it never raises: tests/drivers/sim/test_sim_core_fuzz.py.
"""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from tempfile import TemporaryDirectory

from fuzz_frames import frames_near
from hypothesis import given, settings
from hypothesis import strategies as st
from virtual_clock import virtual_loop

from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.nmt import NmtState
from drivers.cia301.objects import Address
from drivers.cia402.power import Command, PowerState, command_of
from drivers.devices.catalog import Catalog
from drivers.errors import BadValue, CanaxisError
from drivers.sim.module import SimulatedModule
from drivers.sim.panel import COMMANDS
from drivers.sim.station import Station
from drivers.sim.storage import FileStore, StoreError

PROFILE = Catalog.load().profile("TMCM-3216")
CONTROLWORD = 0x6040
COB_IDS = (
    *(cob.NMT, cob.SYNC, cob.LSS_REQUEST, cob.sdo_request(1), cob.heartbeat(127), cob.sdo_response(1)),
    *(cob.rpdo(number, node) for number in (1, 2, 3, 4) for node in (1, 2)),
)
MOVABLE = frozenset(
    {PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE, PowerState.FAULT_REACTION_ACTIVE}
)
START = Frame(cob.NMT, b"\x01\x00")


def wrote(index: int, value: int, size: int, axis: int) -> Frame:
    """An expedited write of one object of an axis."""
    real = PROFILE.spec(index, 0, axis).index
    head = bytes((0x23 | (4 - size) << 2,)) + real.to_bytes(2, "little") + b"\0"
    return Frame(cob.sdo_request(1), head + value.to_bytes(4, "little"))


commands = st.builds(
    wrote,
    st.just(CONTROLWORD),
    st.sampled_from((0x06, 0x07, 0x0F, 0x1F, 0x0F, 0x10F, 0x02, 0x80, 0x00)),
    st.just(2),
    st.integers(0, 2),
) | st.builds(
    lambda chosen, axis: wrote(chosen[0], chosen[1], chosen[2], axis),
    st.sampled_from(((0x6060, 1, 1), (0x6060, 3, 1), (0x6060, 6, 1), (0x607A, 5000, 4), (0x60FF, 9000, 4))),
    st.integers(0, 2),
)
steps = st.lists(
    st.tuples(frames_near(COB_IDS) | commands | st.just(START), st.sampled_from((0.0, 0.0, 0.01, 0.3, 2.0))),
    max_size=50,
)


@given(steps)
def test_a_motor_turns_only_while_its_drive_was_enabled_by_a_command(
    steps: list[tuple[Frame, float]],
) -> None:
    module = SimulatedModule(PROFILE)
    now = 0.0
    module.power_on(now)
    states = [axis.state for axis in module.axes]
    for frame, pause in steps:
        module.on_frame(frame, now)
        look(module, states)
        end = now + pause
        for _ in range(200):
            due = module.next_wakeup(now)
            if due is None or due > end:
                break
            now = due
            module.on_time(now)
            look(module, states)
        now = max(now, end)


def look(module: SimulatedModule, states: list[PowerState]) -> None:
    """What must hold after every step; `states` are those of the step before."""
    for number, axis in enumerate(module.axes):
        if axis.moving:
            assert axis.state in MOVABLE
            assert module.nmt_state is not NmtState.BOOT_UP
        if axis.state is PowerState.OPERATION_ENABLED and states[number] is not axis.state:
            held = module.dictionary.stored(PROFILE.spec(CONTROLWORD, 0, number).address)
            assert isinstance(held, int)
            assert command_of(held) is Command.ENABLE_OPERATION
        states[number] = axis.state


@given(st.lists(frames_near(COB_IDS), max_size=60))
def test_a_module_without_supply_hears_and_says_nothing(frames: list[Frame]) -> None:
    module = SimulatedModule(PROFILE)
    for frame in frames:
        assert not module.hears(frame)
        assert module.on_frame(frame, 1.0) == []
    assert module.next_wakeup(1.0) is None


entries = st.dictionaries(
    st.sampled_from([str(address) for address in PROFILE.objects]) | st.text(max_size=12),
    st.integers() | st.booleans() | st.none() | st.text(max_size=3) | st.floats(),
    max_size=4,
)
memories = st.one_of(
    st.binary(max_size=60),
    st.sampled_from((b"[" * 5000, b"9" * 5000, b'{"2000h:0": ' + b"9" * 5000 + b"}", b"\xff\xfe", b"null")),
    entries.map(lambda values: json.dumps(values).encode()),
)


@settings(max_examples=60)
@given(memories)
def test_any_memory_is_read_or_refused_and_no_module_fails_by_it(memory: bytes) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "memory.json"
        path.write_bytes(memory)
        store = FileStore(path)
        try:
            values = store.load()
        except StoreError as error:
            assert str(path) in str(error)
        else:
            assert all(type(value) is int for value in values.values())
            store.save(values)
            assert store.load() == values
        module = SimulatedModule(PROFILE, store=store)
        assert module.power_on(0.0)
        assert not any(axis.moving for axis in module.axes)
        module.on_frame(START, 0.1)
        module.on_frame(wrote(0x6060, 1, 1, 0), 0.2)
        module.on_time(1.0)


@given(
    st.dictionaries(
        st.integers(0, 0xFFFF).map(lambda n: Address(n, n & 0xFF)), st.integers(-(2**31), 2**32 - 1)
    )
)
@settings(max_examples=30)
def test_what_is_saved_is_loaded(values: dict[Address, int]) -> None:
    with TemporaryDirectory() as folder:
        store = FileStore(Path(folder) / "below" / "memory.json")
        store.save(values)
        assert store.load() == values


json_values = st.recursive(
    st.just(10**400) | st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)


@st.composite
def arguments(draw: st.DrawFn) -> tuple[str, dict[str, object]]:
    """A command of the fault panel with arguments of any kind, most of them named as it wants them."""
    name = draw(st.sampled_from(sorted(COMMANDS)) | st.text(max_size=8))
    known = [parameter.name for parameter in COMMANDS[name].parameters] if name in COMMANDS else []
    near = st.sampled_from(("negative", "home", "0x181", "operational", 0, 1, 2, 0.5, True)) | json_values
    given_: dict[str, object] = {key: draw(near) for key in known if draw(st.integers(0, 9))}
    return name, given_ | draw(st.dictionaries(st.text(max_size=4), json_values, max_size=1))


@settings(max_examples=60)
@given(st.lists(arguments(), max_size=12))
def test_whatever_the_fault_panel_is_asked_it_does_or_says_what_is_allowed(
    asked: list[tuple[str, dict[str, object]]],
) -> None:
    with asyncio.Runner(loop_factory=virtual_loop) as runner:
        runner.run(ask(asked))


async def ask(asked: list[tuple[str, dict[str, object]]]) -> None:
    async with Station([1], listen=None) as station:
        panel = station.panel(1)
        for name, given_ in asked:
            before = panel.state()
            try:
                panel.perform(name, given_)
            except BadValue as error:
                assert error.message
                assert error.hint
                assert panel.state() == before
            except CanaxisError as error:
                assert error.message
        await asyncio.sleep(0.5)
        panel.clear()
        await asyncio.sleep(0.5)
        assert panel.state().powered
