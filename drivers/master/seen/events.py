"""Bounded fan-out of what happens, to any number of subscribers that can't slow anybody down.

Two sorts of events. Status snapshots (kinds `axis` and `node`) replace each other: a slow subscriber gets the
latest of each node and axis. Everything else (`bus`, `emergency`, `motion`, `stop`) is kept in order; only
when a subscriber's bounded queue is full does the oldest go, and the subscriber is told how many it missed.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

LATEST_WINS = frozenset({"axis", "node"})
"""Kinds of which only the latest per node and axis matters."""

HISTORY = 1000
"""How many of the other events are kept for subscribers that come back."""


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened."""

    id: int
    """Counts up by one over all kinds, from 1."""
    kind: str
    """`axis`, `node`, `bus`, `emergency`, `motion`, `stop`, and what others publish in their own words; a
    subscriber may also see its own `missed`.
    """
    time: datetime
    node: int | None
    axis: int | None
    data: Mapping[str, object]
    """`axis`: ``status``; `node`: ``status``; `emergency`: ``record``; `motion`: ``motion``; the rest in
    words.
    """


class Subscription:
    """One subscriber's bounded queue: iterate over it, then `close` it."""

    def __init__(
        self, capacity: int, on_close: Callable[[Subscription], None], kinds: frozenset[str] | None = None
    ) -> None:
        self._capacity = capacity
        self.kinds = kinds
        """The kinds that it wants; None: all."""
        self._on_close = on_close
        self._latest: dict[tuple[str, int | None, int | None], Event] = {}
        self._kept: deque[Event] = deque()
        self._unreported = 0
        self._last_missed = 0
        self._wake = asyncio.Event()
        self._closed = False
        self.missed = 0
        """How many events this subscriber lost, in all."""

    def offer(self, event: Event) -> None:
        """Queue an event of one of its `kinds`; never blocks, never raises."""
        if self._closed:
            return
        if event.kind in LATEST_WINS:
            key = (event.kind, event.node, event.axis)
            self._latest.pop(key, None)  # so that the dictionary stays in the order of the ids
            self._latest[key] = event
        else:
            if len(self._kept) >= self._capacity:
                self._last_missed = self._kept.popleft().id
                self.missed += 1
                self._unreported += 1
            self._kept.append(event)
        self._wake.set()

    def take(self) -> Event | None:
        """The next event in the order of their ids, or None if there is none now."""
        if self._unreported:
            count, self._unreported = self._unreported, 0
            data = {"missed": count, "missed_in_all": self.missed}
            return Event(self._last_missed, "missed", datetime.now(UTC), None, None, data)
        latest = next(iter(self._latest.values()), None)
        if self._kept and (latest is None or self._kept[0].id < latest.id):
            return self._kept.popleft()
        if latest is not None:
            del self._latest[latest.kind, latest.node, latest.axis]
        return latest

    async def get(self) -> Event | None:
        """Wait for the next event; None once the subscription is closed."""
        while not self._closed:
            event = self.take()
            if event is not None:
                return event
            self._wake.clear()
            await self._wake.wait()
        return None

    async def __aiter__(self) -> AsyncIterator[Event]:
        while (event := await self.get()) is not None:
            yield event

    def close(self) -> None:
        """End it; whoever iterates stops. Idempotent."""
        if not self._closed:
            self._closed = True
            self._on_close(self)
            self._wake.set()


class EventHub:
    """Numbers events and hands them to every subscriber."""

    def __init__(self, now: Callable[[], datetime] = lambda: datetime.now(UTC)) -> None:
        self._now = now
        self._subscriptions: set[Subscription] = set()
        self._by_kind: dict[str, tuple[Subscription, ...]] = {}
        """Who wants a kind; filled as kinds are asked for, emptied when somebody comes or goes."""
        self._history: deque[Event] = deque()
        self._forgotten = 0
        self.last_id = 0
        """The id of the newest event; 0: none yet."""

    def publish(
        self, kind: str, *, node: int | None = None, axis: int | None = None, data: Mapping[str, object]
    ) -> None:
        """Number an event and queue it for every subscriber that wants its kind. Never blocks."""
        self.last_id += 1
        event = Event(self.last_id, kind, self._now(), node, axis, data)
        if kind not in LATEST_WINS:
            self._history.append(event)
            if len(self._history) > HISTORY:
                self._forgotten = self._history.popleft().id
        for subscription in self._subscriptions_to(kind):
            subscription.offer(event)

    def is_wanted(self, kind: str) -> bool:
        """Whether anybody subscribes to a kind. A status that nobody wants need not be published."""
        found = self._by_kind.get(kind)  # asked for every status: spare it the call
        return bool(self._subscriptions_to(kind) if found is None else found)

    def subscribe(self, capacity: int = 256, kinds: frozenset[str] | None = None) -> Subscription:
        """A new subscription, to some kinds or (None) all of them.

        It has room for `capacity` events that must not be lost, and for the latest of each status.
        """
        subscription = Subscription(max(1, capacity), self._forget, kinds)
        self._subscriptions.add(subscription)
        self._by_kind.clear()
        return subscription

    def _forget(self, subscription: Subscription) -> None:
        self._subscriptions.discard(subscription)
        self._by_kind.clear()

    def _subscriptions_to(self, kind: str) -> tuple[Subscription, ...]:
        found = self._by_kind.get(kind)
        if found is None:
            found = tuple(each for each in self._subscriptions if each.kinds is None or kind in each.kinds)
            self._by_kind[kind] = found
        return found

    def since(self, last_id: int) -> list[Event] | None:
        """The kept events after `last_id`, oldest first; None if some of them are forgotten, or the id is not
        ours.

        Status events are not among them: take a fresh snapshot instead.
        """
        if last_id < self._forgotten or last_id > self.last_id:
            return None
        return [event for event in self._history if event.id > last_id]

    def close(self) -> None:
        """End every subscription."""
        for subscription in tuple(self._subscriptions):
            subscription.close()
