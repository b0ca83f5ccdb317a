from __future__ import annotations

import pytest

from drivers.bus.faults import Faults, cob_id
from drivers.bus.frame import Frame
from drivers.errors import BadValue

A, B = Frame(0x181, b"a"), Frame(0x281, b"b")


def test_without_a_rule_a_frame_passes_as_it_is() -> None:
    assert Faults().apply(A) == [(0.0, A)]


def test_drop_takes_as_many_as_it_was_told() -> None:
    faults = Faults()
    rule = faults.drop(cob_id(0x181), count=2)
    assert [faults.apply(frame) for frame in (A, B, A, A)] == [[], [(0.0, B)], [], [(0.0, A)]]
    assert rule.hits == 2


def test_an_ended_rule_strikes_no_more() -> None:
    faults = Faults()
    rule = faults.drop()
    assert faults.apply(A) == []
    rule.end()
    assert faults.apply(A) == [(0.0, A)]


def test_rules_add_up_in_their_order() -> None:
    faults = Faults()
    faults.duplicate(cob_id(0x181))
    faults.delay(cob_id(0x181), 0.5, count=1)
    faults.corrupt(lambda frame: frame._replace(data=b""))
    assert faults.apply(A) == [(0.5, A._replace(data=b"")), (0.0, A._replace(data=b""))]


def test_reorder_swaps_pairs() -> None:
    faults = Faults()
    faults.reorder()
    assert faults.apply(A) == []
    assert faults.apply(B) == [(0.0, B), (0.0, A)]


def test_clear_switches_everything_off() -> None:
    faults = Faults()
    faults.drop()
    faults.clear()
    assert faults.apply(A) == [(0.0, A)]


def test_a_delay_of_nothing_is_refused() -> None:
    with pytest.raises(BadValue, match=r"a delay of 0"):
        Faults().delay(cob_id(1), 0.0)
