from __future__ import annotations

from drivers.bus.frame import Frame
from drivers.bus.outbox import Outbox


def drain(outbox: Outbox, now: float) -> list[int]:
    order: list[int] = []
    while (frame := outbox.foremost(now)) is not None:
        order.append(frame.cob_id)
        outbox.pop()
    return order


def test_urgent_frames_leave_first_and_each_kind_in_its_order() -> None:
    outbox = Outbox()
    for cob_id, urgent in ((0x601, False), (0x000, True), (0x201, False), (0x77F, True)):
        assert outbox.put(Frame(cob_id), 0.0, urgent=urgent)
    assert outbox.holds_urgent
    assert drain(outbox, 0.0) == [0x000, 0x77F, 0x601, 0x201]
    assert not outbox


def test_a_flood_of_ordinary_frames_leaves_the_urgent_ones_their_room() -> None:
    outbox = Outbox(capacity=2, reserve=1)
    assert [outbox.put(Frame(0x201), 0.0, urgent=False) for _ in range(3)] == [True, True, False]
    assert outbox.put(Frame(0), 0.0, urgent=True)
    assert not outbox.put(Frame(0), 0.0, urgent=True)
    assert outbox.dropped == 2


def test_a_frame_that_waited_too_long_is_never_sent() -> None:
    outbox = Outbox(stale_after=0.25)
    outbox.put(Frame(0x201), 0.0, urgent=False)
    outbox.put(Frame(0x301), 0.2, urgent=False)
    assert drain(outbox, 0.3) == [0x301]
    assert outbox.dropped == 1


def test_stale_frames_make_room_for_new_ones() -> None:
    outbox = Outbox(capacity=1, stale_after=0.25)
    assert outbox.put(Frame(0x201), 0.0, urgent=False)
    assert outbox.put(Frame(0x301), 1.0, urgent=False)
    assert drain(outbox, 1.0) == [0x301]


def test_clearing_counts_what_it_drops() -> None:
    outbox = Outbox()
    outbox.put(Frame(0x201), 0.0, urgent=False)
    outbox.put(Frame(0x000), 0.0, urgent=True)
    outbox.clear()
    assert (len(outbox), outbox.dropped) == (0, 2)


def test_what_is_superseded_is_taken_back_from_both_queues() -> None:
    box = Outbox()
    for number, urgent in ((0x201, False), (0x301, False), (0x201, True), (0x401, True)):
        box.put(Frame(number), 0.0, urgent=urgent)
    assert box.withdraw((0x201, 0x7FF)) == 2
    left: list[int] = []
    while (frame := box.foremost(0.0)) is not None:
        left.append(frame.cob_id)
        box.pop()
    assert left == [0x401, 0x301]
    assert box.dropped == 0
