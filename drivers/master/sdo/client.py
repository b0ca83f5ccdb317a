"""The SDO channel to one node: one transfer at a time, urgent ones first, nothing ever taken for something
else.

The answers are handled synchronously as the router brings them, and the next request leaves with them, so a
transfer of any length costs its caller one wake-up. A transfer that ends without an answer (time-out, callers
gone, broken protocol) is aborted on the wire, and then the channel stays silent until no answer can come any
more, which is `Timing.sdo_quarantine` after it was due: a late answer finds nobody waiting.

Equal reads share one transfer, if that is sure to bring a value that is new enough:

- a read joins an equal one whose request has not left, and gives it its own priority if that is more urgent;
- one of priority MONITOR also joins an equal one under way: its value is at most one transfer old. Whoever
  decides by what is read (STOP, CONTROL, CONFIGURE) gets a value sampled after it asked;
- nobody gets by joining a value from before a write, or a command by PDO or NMT (`note_command`), that was
  asked for earlier and that a transfer of its own would have come after.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Iterable

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
)
from drivers.errors import CanaxisError, NodeAway
from drivers.master.ground.counters import SdoCounters
from drivers.master.ground.timing import Timing
from drivers.master.sdo.queue import Job, Patience, Priority, SdoQueue
from drivers.master.sdo.verdicts import Verdicts

_EARLY = 0.001
"""Seconds by which an event loop's timer may come too soon: uvloop counts in milliseconds."""


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
        self._request_id = cob.sdo_request(node_id)
        self._send = send
        self._timing = timing or Timing()
        self.counters = counters if counters is not None else SdoCounters()
        self._verdicts = Verdicts(node_id, remedy)
        self._active: Job | None = None
        self._answer_due = 0.0
        self._queue = SdoQueue()
        self._shareable: dict[Address, Job] = {}
        """The newest read of each object that has not ended and that another may join."""
        self._silent_until = 0.0
        self._unanswered: list[SdoTransfer] = []
        """Whose late answers the silence is for."""
        self._timer: asyncio.TimerHandle | None = None
        self._timer_due = math.inf

    # --- the two services ---

    async def upload(
        self, address: Address, *, priority: Priority = Priority.MONITOR, within: float | None = None
    ) -> bytes:
        """Read an object, maybe by joining an equal read (see above).

        Waits its turn for at most `Timing.sdo_queue`, then at most `Timing.sdo_response` for each answer, and
        in all at most `within` seconds (`Timing.sdo_transfer` if left out). Raises `SdoError`, which is
        `SdoAborted`, `SdoTimeout`, `SdoQueueTimeout`, `SdoQueueFull` or `SdoProtocolError`; `NodeAway`;
        `BusError`.
        """
        loop = asyncio.get_running_loop()
        now = loop.time()
        waiter: asyncio.Future[bytes] = loop.create_future()
        patience = self._patience(now, within)
        job = self._shareable.get(address)
        if job is None or not self._may_join(job, priority):
            job = Job(SdoUpload(address), priority, waiter, patience)
            self._shareable[address] = job
            self._submit(job, patience, now)
        else:
            self._join(job, priority, waiter, patience)
        try:
            return await waiter
        except asyncio.CancelledError:
            self._leave(job, waiter)
            raise

    async def download(
        self,
        address: Address,
        data: bytes,
        *,
        priority: Priority = Priority.MONITOR,
        within: float | None = None,
    ) -> None:
        """Write an object, once. As `upload`; after an `SdoTimeout` whether it was written is unknown."""
        loop = asyncio.get_running_loop()
        now = loop.time()
        waiter: asyncio.Future[bytes] = loop.create_future()
        patience = self._patience(now, within)
        job = Job(SdoDownload(address, data), priority, waiter, patience)
        self._submit(job, patience, now)
        try:
            await waiter
        except asyncio.CancelledError:
            self._leave(job, waiter)
            raise

    def note_command(self) -> None:
        """The node is commanded by PDO or NMT: no later read joins one that was asked for before."""
        self._shareable.clear()

    def fail_all(self, error: CanaxisError) -> None:
        """End everything that runs or waits with `error`: the node is gone or started anew."""
        jobs = self._queue.clear()
        if self._active is not None:
            jobs.append(self._active)
        for job in jobs:
            self._fail(job, error)

    def close(self) -> None:
        """End everything, for good."""
        self.fail_all(NodeAway("The network is being closed.", node=self._node_id))
        if self._timer is not None:
            self._timer.cancel()
            self._timer, self._timer_due = None, math.inf

    @property
    def idle(self) -> bool:
        """Whether nothing runs and nothing waits."""
        return self._active is None and not self._queue

    @property
    def waiting(self) -> int:
        """Transfers that wait for their turn; at most `sdo_queue.SIZE`."""
        return len(self._queue)

    # --- what the router brings ---

    def on_frame(self, frame: Frame) -> None:
        """Take an answer in (COB-ID 580h + node)."""
        if len(frame.data) != 8:
            self.counters.malformed += 1
            return
        job = self._active
        if job is None:
            self.counters.late += 1
            return
        match job.transfer.feed(frame.data):
            case Done(data):
                self.counters.completed += 1
                self._succeed(job, data)
            case Send(data):
                self._go_on(job, data)
                return
            case Ignored():
                self.counters.foreign += 1
                return
            case Aborted(code):
                self.counters.aborted_by_node += 1
                self._fail(job, self._verdicts.refusal(job, code))
            case Violation(reason, abort):
                self.counters.violations += 1
                self._abandon(job, abort)
                self._fail(job, self._verdicts.breach(job, reason))
        self._start_next()

    # --- one transfer ---

    def _patience(self, now: float, within: float | None) -> Patience:
        timing = self._timing
        return Patience(now + timing.sdo_queue, now + (timing.sdo_transfer if within is None else within))

    def _submit(self, job: Job, patience: Patience, now: float) -> None:
        """Begin a new job at once if the channel is free, else let it wait, or drive another out."""
        if self._active is None and not self._queue and self._is_quiet_for(job, now):
            self._begin(job, now)
            due = patience.end
        else:
            refused = self._queue.put(job)
            if refused is not None:
                self.counters.refused += 1
                self._fail(refused, self._verdicts.no_room(refused))
            self._start_next()
            due = patience.until(begun=job.begun)
        self._wake_at(due)

    def _may_join(self, job: Job, priority: Priority) -> bool:
        """Whether the value that `job` will bring is new enough for who asks now."""
        return (not job.begun or priority is Priority.MONITOR) and self._queue.keeps_order(job, priority)

    def _join(self, job: Job, priority: Priority, waiter: asyncio.Future[bytes], patience: Patience) -> None:
        self.counters.shared += 1
        job.waiters[waiter] = patience
        if not job.begun and priority < job.priority:
            self._queue.hasten(job, priority)
            self._start_next()
        self._wake_at(patience.until(begun=job.begun))

    def _leave(self, job: Job, waiter: asyncio.Future[bytes]) -> None:
        """A caller was cancelled; the last one takes the transfer with it."""
        if waiter.done() and not waiter.cancelled():
            waiter.exception()  # retrieved here: the caller was cancelled at the same moment
        job.waiters.pop(waiter, None)
        if job.waiters or job.ended:
            return
        if job is self._active:
            self.counters.cancelled += 1
            self._abandon(job, job.transfer.abort_frame())
        else:
            self._queue.remove(job)
        self._retire(job)
        self._start_next()

    def _begin(self, job: Job, now: float) -> None:
        job.begun = True
        self._active = job  # the waiters are there before the request goes out
        self._answer_due = now + self._timing.sdo_response
        self._wake_at(self._answer_due)
        self.counters.requests += 1
        self._transmit(job, job.transfer.request())

    def _go_on(self, job: Job, data: bytes) -> None:
        self._answer_due = asyncio.get_running_loop().time() + self._timing.sdo_response
        self._transmit(job, data)
        self._start_next()

    def _transmit(self, job: Job, data: bytes) -> None:
        try:
            self._send(Frame(self._request_id, data))
        except CanaxisError as error:
            self._fail(job, error)

    def _succeed(self, job: Job, data: bytes) -> None:
        self._retire(job)
        for waiter in job.waiters:
            if not waiter.done():
                waiter.set_result(data)

    def _fail(self, job: Job, error: CanaxisError) -> None:
        self._retire(job)
        _raise_in(job.waiters, error)

    def _retire(self, job: Job) -> None:
        job.ended = True
        if self._active is job:
            self._active = None
        if self._shareable.get(job.address) is job:
            del self._shareable[job.address]

    def _abandon(self, job: Job, abort: bytes) -> None:
        """Abort on the wire a transfer whose answer may still come, and wait that out."""
        self._unanswered.append(job.transfer)
        self._silent_until = self._answer_due + self._timing.sdo_quarantine
        try:
            self._send(Frame(self._request_id, abort))
        except CanaxisError:
            return  # a courtesy: a bus that can't carry it now must not hide the first error

    # --- whose turn it is ---

    def _start_next(self) -> None:
        while self._active is None and (job := self._queue.foremost) is not None:
            now = asyncio.get_running_loop().time()
            if not self._is_quiet_for(job, now):
                self._wake_at(self._silent_until)
                return
            self._queue.remove(job)
            if job.is_wanted:
                self._begin(job, now)
            else:
                self._retire(job)

    def _is_quiet_for(self, job: Job, now: float) -> bool:
        """Whether no late answer can come that could be taken for one to this job."""
        if now + _EARLY >= self._silent_until:
            self._unanswered.clear()
            return True
        # A stop need not wait for the answers that tell themselves apart.
        return job.priority is Priority.STOP and not any(
            job.transfer.could_take_answer_to(other) for other in self._unanswered
        )

    def _wake_at(self, due: float) -> None:
        """Look again then at the latest. One timer for everything, which is seldom set anew."""
        if due < self._timer_due:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = asyncio.get_running_loop().call_at(due, self._look)
            self._timer_due = due

    def _look(self) -> None:
        """See who waited for too long, and when to look again."""
        self._timer, self._timer_due = None, math.inf
        now = asyncio.get_running_loop().time() + _EARLY
        active = self._active
        if active is not None and self._answer_due <= now:
            self.counters.timeouts += 1
            self._abandon(active, active.transfer.abort_frame())
            self._fail(active, self._verdicts.silence(active))
        for job in self._jobs():
            self._dismiss(job, now)
        self._start_next()
        for job in self._jobs():
            self._wake_at(job.due)
        if self._active is not None:
            self._wake_at(self._answer_due)

    def _jobs(self) -> list[Job]:
        return [*self._queue] if self._active is None else [self._active, *self._queue]

    def _dismiss(self, job: Job, now: float) -> None:
        """Tell the callers whose patience has ended; the last one takes the transfer with it."""
        expired = job.expired(now)
        if not expired:
            return
        for waiter in expired:
            del job.waiters[waiter]
        if job.begun:
            error = self._verdicts.slowness(job)
            if not job.waiters:
                self.counters.timeouts += 1
                self._abandon(job, job.transfer.abort_frame())
                self._retire(job)
        else:
            error = self._verdicts.no_turn(job)
            if not job.waiters:
                self._queue.remove(job)
                self._retire(job)
        _raise_in(expired, error)


def _raise_in(waiters: Iterable[asyncio.Future[bytes]], error: CanaxisError) -> None:
    for waiter in waiters:
        if not waiter.done():
            waiter.set_exception(error)
