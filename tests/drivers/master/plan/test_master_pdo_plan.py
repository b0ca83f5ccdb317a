"""The PDO plan: no COB-ID twice, none that is restricted, the same after every start."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.cia301 import cob
from drivers.devices.catalog import Catalog
from drivers.errors import BadValue
from drivers.master.ground.timing import Timing
from drivers.master.plan.pdo_plan import PdoPlan

PROFILE = Catalog.load().profile("TMCM-3216")


def plan_of(*node_ids: int, master: int = 127) -> PdoPlan:
    return PdoPlan.make(dict.fromkeys(node_ids, PROFILE), master, Timing())


def test_axis_0_has_the_node_s_own_identifiers_and_the_others_borrow() -> None:
    plan = plan_of(1)
    axes = plan.nodes[1].axes
    assert plan.nodes[1].donors == (126, 125)
    assert [pdo.cob_id for pdo in axes[0] if pdo.enabled] == [0x181, 0x281, 0x201, 0x301, 0x401, 0x501]
    assert [pdo.cob_id for pdo in axes[1] if pdo.enabled] == [0x1FE, 0x2FE, 0x27E, 0x37E, 0x47E, 0x57E]
    assert [pdo.number for pdo in axes[2] if pdo.enabled] == [129, 130, 129, 130, 131, 132]


def test_what_is_mapped_belongs_to_the_axis() -> None:
    axis = plan_of(1).nodes[1].axes[2]
    assert [str(entry) for entry in axis.status.mapping.entries] == ["7041h:0/16", "7061h:0/8", "70FDh:0/32"]
    assert [str(entry) for entry in axis.position.mapping.entries] == ["7040h:0/16", "707Ah:0/32"]


def test_unused_pdos_are_switched_off() -> None:
    assert all(not pdo.enabled for axis in plan_of(1).nodes[1].axes for pdo in axis.unused)


def test_configured_ids_and_the_master_s_never_donate() -> None:
    assert plan_of(126, 124, master=125).nodes[126].donors == (121, 120)
    assert plan_of(126, 124, master=125).nodes[124].donors == (123, 122)


@settings(max_examples=60)
@given(st.sets(st.integers(1, 126), min_size=1, max_size=42))
def test_no_cob_id_is_given_twice_or_restricted(node_ids: set[int]) -> None:
    try:
        plan = plan_of(*node_ids)
    except BadValue:
        assert 3 * len(node_ids) > 126
        return
    taken = Counter(
        pdo.cob_id for node in plan.nodes.values() for axis in node.axes for pdo in axis if pdo.enabled
    )
    for node_id in node_ids:
        taken.update(
            (cob.emcy(node_id), cob.sdo_request(node_id), cob.sdo_response(node_id), cob.heartbeat(node_id))
        )
    taken.update((cob.NMT, cob.SYNC, cob.TIME, cob.heartbeat(127)))
    assert max(taken.values()) == 1
    assert len(taken) == 18 * len(node_ids) + 4 * len(node_ids) + 4
    assert plan.nodes == plan_of(*sorted(node_ids, reverse=True)).nodes


def test_too_many_axes_are_refused_before_anything_is_sent() -> None:
    with pytest.raises(BadValue, match="not enough free node IDs"):
        plan_of(*range(1, 44))


def test_one_receive_pdo_waits_for_sync_and_the_others_do_not() -> None:
    for axis in plan_of(1).nodes[1].axes:
        assert axis.synchronous.transmission_type == 1
        assert axis.synchronous.mapping == axis.position.mapping
        assert {pdo.transmission_type for pdo in (axis.power, axis.position, axis.velocity)} == {0xFF}
