"""Who may send SYNCs."""

from __future__ import annotations

import pytest

from drivers.bus.frame import Frame
from drivers.errors import NotReady
from drivers.master.link.sync import SyncProducer


def test_one_user_at_a_time_has_the_sync() -> None:
    sent: list[Frame] = []
    sync = SyncProducer(sent.append, lambda _: None)
    sync.claim("a trajectory")
    with pytest.raises(NotReady, match="in use by a trajectory"):
        sync.claim("a coordinated move")
    sync.release("a coordinated move")
    assert [o.code for o in sync.obstacles()] == ["sync_in_use"]
    sync.send()
    sync.release("a trajectory")
    sync.claim("a coordinated move")
    assert sent == [Frame(0x080, b"")]


def test_the_syncs_of_others_are_counted() -> None:
    sync = SyncProducer(lambda _: None, lambda _: None)
    sync.on_sync(Frame(0x080, b""))
    assert sync.foreign == 1
