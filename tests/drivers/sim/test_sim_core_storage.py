"""Save, restore, node ID, bit rate, LSS: what survives a power cycle (manual §2.3, §3.1.7-8, §4.2.62-66)."""

from __future__ import annotations

from pathlib import Path

import pytest
from sim_core_kit import Bench, shown

from drivers.cia301.nmt import NmtCommand, NmtState
from drivers.cia301.objects import Address
from drivers.sim.storage import FileStore, MemoryStore, StoreError

SAVE, LOAD = 0x65766173, 0x64616F6C


def cycle(bench: Bench) -> None:
    bench.module.power_off(bench.now)
    bench.module.power_on(bench.now)


def test_nothing_survives_unsaved() -> None:
    bench = Bench()
    bench.write(0x2010, 0, 77)
    cycle(bench)
    assert bench.read(0x2010) != 77


@pytest.mark.parametrize(("sub", "kept"), [(1, (11, 12, 13)), (5, (0, 12, 0)), (6, (0, 0, 13))])
def test_save_keeps_its_group(sub: int, kept: tuple[int, ...]) -> None:
    bench = Bench()
    for axis in range(3):
        bench.write(0x2012 + 0x200 * axis, 0, 11 + axis)
    assert bench.write(0x1010, sub, SAVE) is None
    assert bench.read(0x1010, sub) == 1
    cycle(bench)
    assert tuple(bench.read(0x2012 + 0x200 * axis) for axis in range(3)) == kept


@pytest.mark.parametrize(
    ("index", "sub", "value", "abort"),
    [
        (0x1010, 1, LOAD, 0x08000020),
        (0x1010, 1, 1, 0x08000020),
        (0x1010, 3, SAVE, 0x08000020),  # no such group
        (0x1011, 1, SAVE, 0x08000020),
        (0x1011, 3, LOAD, 0x08000020),
        (0x2706, 1, 0, 0x08000020),
        (0x1010, 7, SAVE, 0x06090011),
    ],
)
def test_wrong_signatures_are_refused(index: int, sub: int, value: int, abort: int) -> None:
    assert Bench().write(index, sub, value) == abort


def test_a_broken_memory_gives_06060000h_and_keeps_the_old() -> None:
    store = MemoryStore()
    bench = Bench(store=store)
    bench.write(0x2012, 0, 5)
    bench.write(0x1010, 1, SAVE)
    store.broken = True
    bench.write(0x2012, 0, 6)
    assert bench.write(0x1010, 1, SAVE) == 0x06060000
    assert bench.write(0x1011, 1, LOAD) == 0x06060000
    assert bench.read(0x1010, 1) == 1
    cycle(bench)
    assert bench.read(0x2012) == 5


def test_restore_takes_effect_after_the_reset() -> None:
    bench = Bench()
    for axis in range(2):
        bench.write(0x2012 + 0x200 * axis, 0, 5)
    bench.write(0x1010, 1, SAVE)
    assert bench.write(0x1011, 4, LOAD) is None
    assert bench.read(0x2012) == 5
    bench.nmt(NmtCommand.RESET_NODE)
    assert (bench.read(0x2012), bench.read(0x2212)) == (0, 5)


def test_restore_all_keeps_node_id_and_bit_rate() -> None:
    bench = Bench()
    bench.write(0x2705, 0, 9, "B")
    bench.write(0x1010, 1, SAVE)
    assert bench.write(0x1011, 1, LOAD) is None
    assert bench.write(0x1011, 2, LOAD) is None
    cycle(bench)
    assert bench.node == 9


@pytest.mark.parametrize(("index", "sub"), [(0x2706, 1), (0x1010, 2), (0x1010, 1)])
def test_node_id_and_bit_rate_are_saved_and_hold_after_the_reset(index: int, sub: int) -> None:
    bench = Bench()
    bench.write(0x2705, 0, 42, "B")
    bench.write(0x2704, 0, 250, "H")
    assert bench.write(index, sub, SAVE) is None
    assert bench.node == 1
    assert (bench.read(0x2707, form="H"), bench.read(0x2708, form="B")) == (1000, 1)
    assert bench.nmt(NmtCommand.RESET_NODE) == ["72A#00"]
    assert (bench.module.node_id, bench.module.bit_rate) == (42, 250)
    assert (bench.read(0x2705, form="B"), bench.read(0x2708, form="B")) == (42, 42)
    assert bench.read(0x1014) == 0xAA
    assert bench.read(0x1800, 1) == 0x400001AA


def test_a_file_survives_the_process(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "module.json"
    first = Bench(store=FileStore(path))
    first.write(0x2012, 0, 4711)
    first.write(0x1010, 1, SAVE)
    assert Bench(store=FileStore(path)).read(0x2012) == 4711
    assert [entry.name for entry in path.parent.iterdir()] == ["module.json"]


@pytest.mark.parametrize(
    "text", ["[" * 5000, '{"2000h:0": true}', "{", "[]", '{"2012": 1}', '{"2012h:0": "x"}']
)
def test_a_spoilt_file_is_told_and_counts_as_empty_at_power_on(tmp_path: Path, text: str) -> None:
    path = tmp_path / "module.json"
    path.write_text(text)
    with pytest.raises(StoreError):
        FileStore(path).load()
    bench = Bench(store=FileStore(path))
    assert bench.read(0x2012) == 0
    assert bench.write(0x1010, 1, SAVE) == 0x06060000


def test_what_the_file_holds_beyond_the_objects_or_their_ranges_is_not_taken() -> None:
    store = MemoryStore()
    store.save({Address(0x5FFF): 1, Address(0x2000): 99, Address(0x1017): 5, Address(0x2012): 8})
    bench = Bench(store=store)
    assert (bench.read(0x2012), bench.read(0x1017, form="H")) == (8, 0)
    assert bench.module.dictionary.stored(Address(0x2000)) == 8


# --- LSS ---------------------------------------------------------------------


def test_an_unconfigured_module_answers_to_lss_only_and_boots_with_the_id_that_it_is_given() -> None:
    bench = Bench(255)
    assert bench.boot == []
    assert bench.module.nmt_state is NmtState.BOOT_UP
    assert bench.nmt(NmtCommand.START) == []
    assert bench.send(0x67F, "40 00 10 00 00 00 00 00") == []
    assert bench.send(0x7E5, "4c 00 00 00 00 00 00 00") == ["7E4#50 00 00 00 00 00 00 00"]
    assert bench.send(0x7E5, "04 01 00 00 00 00 00 00") == []
    assert bench.send(0x7E5, "11 07 00 00 00 00 00 00") == ["7E4#11 00 00 00 00 00 00 00"]
    assert bench.send(0x7E5, "04 00 00 00 00 00 00 00") == ["707#00"]
    assert bench.module.node_id == 7
    assert bench.read(0x1014) == 0x87


def test_lss_changes_the_node_id_at_the_next_reset_of_the_communication() -> None:
    bench = Bench(1)
    bench.send(0x7E5, "04 01 00 00 00 00 00 00")
    bench.send(0x7E5, "11 07 00 00 00 00 00 00")
    assert bench.send(0x7E5, "04 00 00 00 00 00 00 00") == []
    assert bench.module.node_id == 1
    assert bench.nmt(NmtCommand.RESET_COMMUNICATION) == ["707#00"]
    cycle(bench)
    assert bench.module.node_id == 1, "it was not stored"


def test_lss_stores_and_2705h_agrees() -> None:
    bench = Bench(1, serial=5)
    bench.send(0x7E5, "04 01 00 00 00 00 00 00")
    bench.send(0x7E5, "11 07 00 00 00 00 00 00")
    bench.send(0x7E5, "13 00 03 00 00 00 00 00")
    assert bench.send(0x7E5, "17 00 00 00 00 00 00 00") == ["7E4#17 00 00 00 00 00 00 00"]
    assert bench.read(0x2705, form="B") == 7
    cycle(bench)
    assert (bench.module.node_id, bench.module.bit_rate) == (7, 250)


def test_lss_tells_of_a_broken_memory() -> None:
    store = MemoryStore()
    bench = Bench(store=store)
    store.broken = True
    bench.send(0x7E5, "04 01 00 00 00 00 00 00")
    assert bench.send(0x7E5, "17 00 00 00 00 00 00 00") == ["7E4#17 02 00 00 00 00 00 00"]


def test_lss_finds_the_module_by_its_identity() -> None:
    bench = Bench(serial=0x01020304)
    for frame in ("40 86 02 00 00", "41 90 0c 00 00", "42 04 00 01 00"):
        assert bench.send(0x7E5, frame + " 00 00 00") == []
    assert bench.send(0x7E5, "43 04 03 02 01 00 00 00") == ["7E4#44 00 00 00 00 00 00 00"]
    assert bench.send(0x7E5, "5e 00 00 00 00 00 00 00") == ["7E4#5e 01 00 00 00 00 00 00"]


def test_255_in_2705h_makes_it_unconfigured_after_the_reset() -> None:
    bench = Bench()
    bench.write(0x2705, 0, 255, "B")
    bench.write(0x2706, 1, SAVE)
    assert bench.nmt(NmtCommand.RESET_NODE) == []
    assert bench.module.node_id is None


@pytest.mark.parametrize("node_id", [0, 128, 254, -1])
def test_no_other_node_ids(node_id: int) -> None:
    with pytest.raises(ValueError, match="node ID"):
        Bench(node_id)


def test_a_second_power_on_is_a_power_cycle() -> None:
    bench = Bench()
    bench.write(0x2012, 0, 5)
    assert shown(bench.module.power_on(1.0)) == ["701#00"]
    assert ("power_off", 1.0) in bench.axes[0].log
