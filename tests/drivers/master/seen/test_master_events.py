"""The event hub: nobody slows anybody down, and what is lost is told."""

from __future__ import annotations

import asyncio

import pytest

from drivers.master.seen.events import HISTORY, Event, EventHub, Subscription

pytestmark = pytest.mark.looptime


def taken(subscription: Subscription) -> Event:
    """The next event, which must be there."""
    event = subscription.take()
    assert event is not None
    return event


async def test_status_is_latest_wins_per_axis() -> None:
    hub = EventHub()
    subscription = hub.subscribe()
    for value in range(1000):
        hub.publish("axis", node=1, axis=value % 2, data={"status": value})
    events = [taken(subscription), taken(subscription)]
    assert [event.data["status"] for event in events] == [998, 999]
    assert subscription.take() is None
    assert subscription.missed == 0


async def test_everything_comes_in_the_order_of_its_id() -> None:
    hub = EventHub()
    subscription = hub.subscribe()
    hub.publish("axis", node=1, axis=0, data={})
    hub.publish("motion", node=1, axis=0, data={})
    hub.publish("axis", node=1, axis=0, data={})
    hub.publish("stop", data={})
    assert [taken(subscription).id for _ in range(3)] == [2, 3, 4]


async def test_a_full_queue_drops_the_oldest_and_says_how_many() -> None:
    hub = EventHub()
    slow, fast = hub.subscribe(capacity=3), hub.subscribe(capacity=100)
    for number in range(10):
        hub.publish("emergency", node=1, data={"number": number})
    told = taken(slow)
    assert (told.kind, told.data["missed"]) == ("missed", 7)
    assert [taken(slow).data["number"] for _ in range(3)] == [7, 8, 9]
    assert slow.take() is None
    assert slow.missed == 7
    assert fast.missed == 0


async def test_iterating_waits_and_ends_with_close() -> None:
    hub = EventHub()
    subscription = hub.subscribe()
    seen: list[str] = []

    async def read() -> None:
        async for event in subscription:
            seen.append(event.kind)  # noqa: PERF401 - it is watched while it grows

    reader = asyncio.create_task(read())
    await asyncio.sleep(0)
    hub.publish("bus", data={})
    hub.publish("stop", data={})
    await asyncio.sleep(0.01)
    assert seen == ["bus", "stop"]
    subscription.close()
    await reader
    hub.publish("bus", data={})
    assert seen == ["bus", "stop"]


async def test_since_gives_what_a_returning_subscriber_missed() -> None:
    hub = EventHub()
    for number in range(5):
        hub.publish("bus", data={"number": number})
        hub.publish("axis", node=1, axis=0, data={})
    missed = hub.since(4)
    assert missed is not None
    assert [event.data["number"] for event in missed] == [2, 3, 4]
    assert hub.since(hub.last_id) == []
    assert hub.since(hub.last_id + 1) is None


async def test_since_admits_what_is_forgotten() -> None:
    hub = EventHub()
    for _ in range(HISTORY + 5):
        hub.publish("bus", data={})
    assert hub.since(4) is None
    kept = hub.since(5)
    assert kept is not None
    assert len(kept) == HISTORY


async def test_a_kind_is_wanted_as_long_as_somebody_subscribes_to_it() -> None:
    hub = EventHub()
    assert not hub.is_wanted("axis")
    journal = hub.subscribe(kinds=frozenset({"bus"}))
    assert (hub.is_wanted("axis"), hub.is_wanted("bus")) == (False, True)
    everything = hub.subscribe()
    assert hub.is_wanted("axis")
    hub.publish("axis", node=1, axis=0, data={})
    assert journal.take() is None
    assert taken(everything).id == hub.last_id
    everything.close()
    journal.close()
    assert not hub.is_wanted("bus")
