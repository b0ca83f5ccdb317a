"""The SDO channel to one node: one transfer at a time, urgent ones first, nothing ever taken for something
else.

The answers are handled synchronously as the router brings them, so a segmented transfer costs one task
wake-up. A transfer that ends without an answer (time-out, caller cancelled, broken protocol) is aborted on
the wire, and then the channel stays silent for `Timing.sdo_quarantine`, so that its late answer finds nobody
waiting.
"""

from __future__ import annotations

import asyncio
import enum
import heapq
import itertools
from collections.abc import Callable
from dataclasses import dataclass

from drivers.bus.frame import Frame
from drivers.cia301 import cob
from drivers.cia301.objects import Address
from drivers.cia301.sdo import (
    Aborted,
    Done,
    Ignored,
    SdoDownload,
    SdoTransfer,
    SdoUpload,
    Send,
    Violation,
    abort_meaning,
)
from drivers.errors import CanaxisError, NodeAway, SdoAborted, SdoProtocolError, SdoTimeout
from drivers.master.counters import SdoCounters
from drivers.master.timing import Timing
from drivers.master.where import Where


class Priority(enum.IntEnum):
    """Who goes first when several wait for the channel; first come, first served within one."""

    STOP = 0
    CONTROL = 1
    CONFIGURE = 2
    MONITOR = 3


@dataclass(slots=True)
class _Active:
    transfer: SdoTransfer
    writes: bool
    answer: asyncio.Future[bytes]
    timer: asyncio.TimerHandle


class SdoClient:
    """Reads and writes objects of one node as bytes. `send` puts a frame on the bus or raises `BusError`."""

    def __init__(
        self,
        node_id: int,
        send: Callable[[Frame], None],
        timing: Timing | None = None,
        counters: SdoCounters | None = None,
        remedy: Callable[[int], str] | None = None,
    ) -> None:
        """`remedy` says, for an abort code, what to do about it on this model; "" where it doesn't know."""
        self._node_id = node_id
        self._send = send
        self._timing = timing or Timing()
        self.counters = counters if counters is not None else SdoCounters()
        self._remedy = remedy
        self._active: _Active | None = None
        self._held = False
        self._silent_until = 0.0
        self._release_timer: asyncio.TimerHandle | None = None
        self._waiting: list[tuple[Priority, int, asyncio.Future[None]]] = []
        self._tickets = itertools.count()

    # --- the two services ---

    async def upload(self, address: Address, *, priority: Priority = Priority.MONITOR) -> bytes:
        """Read an object.

        Waits its turn for at most `Timing.sdo_queue`, then at most `Timing.sdo_response` for each answer.
        Raises `SdoAborted`, `SdoTimeout`, `SdoProtocolError`, `NodeAway` or `BusError`.
        """
        return await self._perform(SdoUpload(address), priority, writes=False)

    async def download(self, address: Address, data: bytes, *, priority: Priority = Priority.MONITOR) -> None:
        """Write an object. As `upload`; after an `SdoTimeout` whether it was written is unknown."""
        await self._perform(SdoDownload(address, data), priority, writes=True)

    def fail_all(self, error: CanaxisError) -> None:
        """End everything that runs or waits with `error`: the node is gone or started anew."""
        active = self._active
        if active is not None and not active.answer.done():
            active.answer.set_exception(error)
        for _, _, turn in self._waiting:
            if not turn.done():
                turn.set_exception(error)

    def close(self) -> None:
        """End everything, for good."""
        self.fail_all(NodeAway("The network is being closed.", node=self._node_id))
        if self._release_timer is not None:
            self._release_timer.cancel()
            self._release_timer = None

    @property
    def idle(self) -> bool:
        """Whether nothing runs and nothing waits."""
        return not self._held and not self._waiting

    # --- what the router brings ---

    def on_frame(self, frame: Frame) -> None:
        """Take an answer in (COB-ID 580h + node)."""
        active = self._active
        if len(frame.data) != 8:
            self.counters.malformed += 1
            return
        if active is None or active.answer.done():
            self.counters.late += 1
            return
        step = active.transfer.feed(frame.data)
        match step:
            case Ignored():
                self.counters.foreign += 1
            case Send(data):
                self._transmit_next(active, data)
            case Done(data):
                self.counters.completed += 1
                active.answer.set_result(data)
            case Aborted(code):
                self.counters.aborted_by_node += 1
                active.answer.set_exception(self._refusal(active.transfer.address, code, active.writes))
            case Violation(reason, abort):
                self.counters.violations += 1
                self._try_to_send(abort)
                self._keep_silent()
                active.answer.set_exception(
                    SdoProtocolError(
                        f"Node {self._node_id} broke the protocol at {active.transfer.address}: {reason}.",
                        **self._where(active.transfer.address),
                    )
                )

    # --- one transfer ---

    async def _perform(self, transfer: SdoTransfer, priority: Priority, *, writes: bool) -> bytes:
        await self._take_turn(transfer.address, priority)
        active: _Active | None = None
        try:
            loop = asyncio.get_running_loop()
            active = _Active(
                transfer,
                writes,
                loop.create_future(),
                loop.call_later(self._timing.sdo_response, self._expire),
            )
            self._active = active  # the waiter is there before the request goes out
            self.counters.requests += 1
            self._send(self._frame(transfer.request()))
            return await active.answer
        except asyncio.CancelledError:
            if active is not None and (active.answer.cancelled() or not active.answer.done()):
                self.counters.cancelled += 1
                self._try_to_send(transfer.abort_frame())
                self._keep_silent()
            raise
        finally:
            if active is not None:
                active.timer.cancel()
                if active.answer.done() and not active.answer.cancelled():
                    active.answer.exception()  # retrieved here if the caller was cancelled at the same moment
            self._active = None
            self._release()

    def _transmit_next(self, active: _Active, data: bytes) -> None:
        active.timer.cancel()
        active.timer = asyncio.get_running_loop().call_later(self._timing.sdo_response, self._expire)
        try:
            self._send(self._frame(data))
        except CanaxisError as error:
            active.answer.set_exception(error)

    def _expire(self) -> None:
        active = self._active
        if active is None or active.answer.done():
            return
        self.counters.timeouts += 1
        self._try_to_send(active.transfer.abort_frame())
        self._keep_silent()
        address = active.transfer.address
        if active.writes:
            error = SdoTimeout(
                f"Node {self._node_id} did not answer to the write of {address}; the outcome is unknown.",
                **self._where(address),
            )
        else:
            error = SdoTimeout(
                f"Node {self._node_id} did not answer to the read of {address}.",
                hint="Check the node's supply and cable, then read again.",
                **self._where(address),
            )
        active.answer.set_exception(error)

    def _refusal(self, address: Address, code: int, writes: bool) -> SdoAborted:
        meaning = abort_meaning(code)
        verb = "the write" if writes else "the read"
        return SdoAborted(
            f"Node {self._node_id} refused {verb} of {address}: {meaning} (SDO abort {code:08X}h).",
            abort_code=code,
            meaning=meaning,
            node=self._node_id,
            index=address.index,
            sub=address.sub,
        )

    def _where(self, address: Address) -> Where:
        return {"node": self._node_id, "index": address.index, "sub": address.sub}

    def _frame(self, data: bytes) -> Frame:
        return Frame(cob.sdo_request(self._node_id), data)

    def _try_to_send(self, data: bytes) -> None:
        """An abort is a courtesy: a bus that can't carry it now must not hide the first error."""
        try:
            self._send(self._frame(data))
        except CanaxisError:
            return

    # --- the queue ---

    def _keep_silent(self) -> None:
        self._silent_until = asyncio.get_running_loop().time() + self._timing.sdo_quarantine

    async def _take_turn(self, address: Address, priority: Priority) -> None:
        loop = asyncio.get_running_loop()
        if not self._held and not self._waiting and loop.time() >= self._silent_until:
            self._held = True
            return
        turn: asyncio.Future[None] = loop.create_future()
        heapq.heappush(self._waiting, (priority, next(self._tickets), turn))
        if not self._held:
            self._grant_when_quiet()
        try:
            async with asyncio.timeout(self._timing.sdo_queue):
                await turn
        except TimeoutError:
            self._hand_on(turn)
            raise SdoTimeout(
                f"The queue of node {self._node_id} did not move in time; nothing was sent for {address}.",
                hint="Check that the node answers at all; then try again.",
                **self._where(address),
            ) from None
        except BaseException:
            self._hand_on(turn)
            raise

    def _hand_on(self, turn: asyncio.Future[None]) -> None:
        """A waiter gave up; if it had just been granted the channel, the next one gets it."""
        granted = turn.done() and not turn.cancelled() and turn.exception() is None
        self._waiting = [entry for entry in self._waiting if entry[2] is not turn]
        heapq.heapify(self._waiting)
        if granted:
            self._release()

    def _release(self) -> None:
        self._held = False
        self._grant_when_quiet()

    def _grant_when_quiet(self) -> None:
        if self._release_timer is not None:
            return
        loop = asyncio.get_running_loop()
        silence = self._silent_until - loop.time()
        if silence > 0:
            self._release_timer = loop.call_later(silence, self._silence_over)
        else:
            self._grant()

    def _silence_over(self) -> None:
        self._release_timer = None
        if not self._held:
            self._grant_when_quiet()

    def _grant(self) -> None:
        while self._waiting and not self._held:
            _, _, turn = heapq.heappop(self._waiting)
            if not turn.done():
                self._held = True
                turn.set_result(None)
