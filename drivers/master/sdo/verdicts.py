"""What is said of an SDO transfer that did not succeed."""

from __future__ import annotations

from collections.abc import Callable

from drivers.cia301.sdo import abort_meaning
from drivers.errors import SdoAborted, SdoProtocolError, SdoQueueFull, SdoQueueTimeout, SdoTimeout
from drivers.master.ground.where import Where
from drivers.master.sdo.queue import Job


class Verdicts:
    """The errors of one node's transfers. `remedy` says what to do about an abort code; "" if it can't."""

    def __init__(self, node_id: int, remedy: Callable[[int], str] | None) -> None:
        self._node = f"Node {node_id}"
        self._node_id = node_id
        self._remedy = remedy

    def refusal(self, job: Job, code: int) -> SdoAborted:
        """The node aborted it."""
        meaning = abort_meaning(code)
        return SdoAborted(
            f"{self._node} refused {job}: {meaning} (SDO abort {code:08X}h).",
            abort_code=code,
            meaning=meaning,
            hint=None if self._remedy is None else self._remedy(code),
            node=self._node_id,
            index=job.address.index,
            sub=job.address.sub,
        )

    def breach(self, job: Job, reason: str) -> SdoProtocolError:
        """The node answered against the rules."""
        return SdoProtocolError(f"{self._node} broke the protocol at {reason}.", **self._where(job))

    def silence(self, job: Job) -> SdoTimeout:
        """The node did not answer."""
        return self._timeout(job, "did not answer")

    def slowness(self, job: Job) -> SdoTimeout:
        """The node answered, but the caller's time was over before the end."""
        return self._timeout(job, "did not get to the end of")

    def no_turn(self, job: Job) -> SdoQueueTimeout:
        """It waited for too long."""
        return SdoQueueTimeout(
            f"The queue of node {self._node_id} did not move in time; nothing was sent for {job}.",
            **self._where(job),
        )

    def no_room(self, job: Job) -> SdoQueueFull:
        """It found no room, or lost it."""
        return SdoQueueFull(
            f"The queue of node {self._node_id} is full; nothing was sent for {job}.", **self._where(job)
        )

    def _timeout(self, job: Job, what: str) -> SdoTimeout:
        if job.writes:
            return SdoTimeout(f"{self._node} {what} {job}; the outcome is unknown.", **self._where(job))
        return SdoTimeout(
            f"{self._node} {what} {job}.",
            hint="Check the node's supply and cable, then read again.",
            **self._where(job),
        )

    def _where(self, job: Job) -> Where:
        return {"node": self._node_id, "index": job.address.index, "sub": job.address.sub}
