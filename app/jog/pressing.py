"""What a client holds down: each press from its first hold to the end of the axis's jog.

Nothing here keeps an axis turning: a hold that counts is passed on to the axis's own dead man. This side may
hang, or end at any point; the axis stops all the same.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from app.access.audit import AuditTrail
from app.access.schemas import Asker
from app.axes.units import Scale
from app.axes.views import axis_path
from app.http import problems
from app.http.paths import operation_path
from app.http.problems import ApiError, ProblemReply
from app.http.schemas import Problem
from app.http.tasks import Tasks
from app.jog import schemas as messages
from app.jog import views
from app.jog.outbox import Outbox
from app.jog.session import Hold, JogSession
from app.leases.book import Lease
from app.leases.leases import LeaseEnd, Leases
from app.operations.register import OperationRegister
from drivers.errors import AxisFault, CanaxisError
from drivers.master.axis.axis import Axis
from drivers.master.motions.jogging import Jog, JogEnd
from drivers.master.motions.motion import MotionKind, MotionState, Operation
from drivers.master.plan.requests import JogRequest, check_velocity

LOSSES = frozenset({"leased", "lease_lost"})
"""Refusals of a hold by which its axis is somebody else's, or nobody's any more."""
PRESS_OVER = "It was let go before the axis could begin."


class _PressOver(Exception):
    """What was to begin is not wanted any more."""


@dataclass(frozen=True, slots=True)
class Means:
    """The parts of the service that a jog takes."""

    operations: OperationRegister
    leases: Leases
    tasks: Tasks
    audit: AuditTrail
    silence: float
    """Seconds without a hold after which an axis is stopped."""


class Pressing:
    """One client's presses on one axis. What is to be said of them goes into the outbox."""

    def __init__(self, means: Means, axis: Axis, asker: Asker, token: str | None, outbox: Outbox) -> None:
        """`token`: of the lease under which the connection was opened."""
        self._means = means
        self._axis = axis
        self._asker = asker
        self._token = token
        self._outbox = outbox
        self._loop = asyncio.get_running_loop()
        self._session = JogSession(means.silence)
        self._under: Lease | None = None
        """The lease of the axis when it was last held."""
        self._jog: Jog | None = None
        self._velocity = 0
        self._starts: set[asyncio.Task[None]] = set()

    @property
    def jog(self) -> Jog | None:
        """What turns the axis, or ramps it down."""
        return self._jog

    @property
    def state(self) -> messages.JogState:
        """How far it is, in the client's words."""
        if self._jog is not None:
            return "turning" if self._jog.held else "stopping"
        if self._session.busy:
            return "starting"
        return "used_up" if self._session.used_up else "idle"

    # --- what the client does ---

    def hold(self, hold: messages.HoldMessage, now: float, *, seen: float, way: float | None) -> None:
        """A hold came, whose sender had last seen what was sent at `seen`.

        `way`: seconds there and back, if that is known.
        """
        outcome: str
        try:
            self._velocity, acceleration = self._wanted(hold)
        except (ApiError, CanaxisError) as error:
            self._session.use_up()
            if self._jog is not None:
                lost = isinstance(error, ApiError) and error.type.code in LOSSES
                self._jog.end(JogEnd.LEASE if lost else JogEnd.RELEASED)
            self.refuse(_problem(error), hold.seq)
            outcome, counts = "refused", False
        else:
            became = self._session.hold(hold.seq, now, seen)
            outcome, counts = became.value, became.counts
            if became is Hold.BEGINS:
                self._begin(hold, acceleration)
            elif counts and self._jog is not None:
                self._jog.hold(self._velocity, now)
            if counts and way is not None and self._jog is not None:
                self._jog.note_round_trip(way)

        def ack(stamp: float) -> messages.AckMessage:
            position, velocity = views.where(self._axis)
            return messages.AckMessage.model_validate(
                {
                    "stamp": stamp,
                    "seq": hold.seq,
                    "sent": hold.sent,
                    "counts": counts,
                    "outcome": outcome,
                    "round_trip_ms": views.ms(way),
                    "jog": self.state,
                    "position": position,
                    "velocity": velocity,
                }
            )

        self._outbox.acknowledge(ack)

    def release(self) -> None:
        """The press is over."""
        self._session.release()
        if self._jog is not None:
            self._jog.end(JogEnd.RELEASED)

    def hold_under(self, token: str) -> None:
        """Hold under this lease from now on."""
        self._token = token
        try:
            self._check_lease()
        except ApiError as error:
            self.refuse(_problem(error))

    def let_go(self) -> None:
        """The connection is over: nobody holds any more."""
        self._session.use_up()
        if self._jog is not None:
            self._jog.end(JogEnd.CLOSED)

    async def begun(self) -> None:
        """Wait until nothing is being begun any more."""
        await asyncio.gather(*self._starts)

    def on_lease_end(self, lease: Lease, _: LeaseEnd) -> None:
        """A lease ended: a jog under it does too."""
        if self._jog is not None and self._under is not None and self._under.id == lease.id:
            self._jog.end(JogEnd.LEASE)

    def refuse(self, reply: ProblemReply, seq: int | None = None) -> None:
        """Say that a message, or a press, is refused."""
        said = Problem.model_validate(reply.body)
        self._outbox.put(lambda stamp: messages.ProblemMessage(stamp=stamp, seq=seq, problem=said))

    # --- what comes of it ---

    def _wanted(self, hold: messages.HoldMessage) -> tuple[int, int | None]:
        """Velocity and acceleration in steps. Raises `ApiError`, `BadValue`; the axis's lease is heeded."""
        self._check_lease()
        self._under = self._means.leases.of(self._axis)
        scale = Scale.named(hold.unit, self._axis.config)
        velocity = scale.steps("velocity", hold.velocity)
        check_velocity(velocity)
        return velocity, scale.rate("acceleration", hold.acceleration)

    def _check_lease(self) -> None:
        self._means.leases.check((self._axis,), self._token)

    def _begin(self, hold: messages.HoldMessage, acceleration: int | None) -> None:
        task = asyncio.ensure_future(self._start(hold, acceleration))
        self._starts.add(task)
        task.add_done_callback(self._starts.discard)

    async def _start(self, hold: messages.HoldMessage, acceleration: int | None) -> None:
        asked = hold.model_dump(exclude_none=True, include={"velocity", "unit", "acceleration"})

        def begin(operation_id: str) -> Operation:
            if not self._session.begins(self._loop.time()):
                raise _PressOver
            self._check_lease()  # it may have ended while the record was written
            request = JogRequest(self._velocity, acceleration, self._means.silence)
            jog = self._axis.jog(request, held_at=self._session.held_at, operation_id=operation_id)
            self._jog = jog
            jog.watch(self._on_change)
            return jog

        entry: dict[str, Any] = {"body": asked}
        try:
            operation = await self._means.tasks.command(
                self._means.operations.start(
                    MotionKind.JOG,
                    (self._axis,),
                    asked | {"velocity_steps": self._velocity},
                    begin,
                    asked_by=self._asker,
                )
            )
            entry["operation"] = operation.id
        except _PressOver:
            entry["refused"] = PRESS_OVER
            silent = self._session.used_up
            self._outbox.put(
                lambda stamp: messages.StoppedMessage(
                    stamp=stamp,
                    reason="silence" if silent else "released",
                    detail=PRESS_OVER,
                    hint="",
                    operation=None,
                    result=None,
                )
            )
        except (ApiError, CanaxisError) as error:
            self._session.refused()
            reply = _problem(error)
            motion = self._axis.motion
            if motion is not None and not motion.done:
                reply.body["operation"] = operation_path(motion.id)
            self.refuse(reply, hold.seq)
            entry |= {"status": reply.status, "refused": reply.body["code"]}
        self._note(entry)

    def _on_change(self, operation: Operation) -> None:
        jog = self._jog
        if jog is not operation or jog is None or not jog.done:
            return
        self._jog = None
        self._session.at_rest(released=jog.over is JogEnd.RELEASED)
        reason = self._reason(jog)
        self._note({"operation": jog.id, "stopped": reason})
        if jog.over is JogEnd.CLOSED:
            return
        error = jog.error

        def stopped(stamp: float) -> messages.StoppedMessage:
            return messages.StoppedMessage.model_validate(
                {
                    "stamp": stamp,
                    "reason": reason,
                    "detail": "The axis stands." if error is None else error.message,
                    "hint": "" if error is None else error.hint,
                    "operation": operation_path(jog.id),
                    "result": self._means.operations.reply_for(jog).result,
                }
            )

        self._outbox.put(stopped)

    def _reason(self, jog: Jog) -> str:
        if jog.state is MotionState.FAILED:
            return "fault" if isinstance(jog.error, AxisFault) else "failed"
        if jog.over is not None:
            return jog.over.value
        if self._under is not None and not self._holds(self._under):
            return "lease"  # its end had the axis stopped
        return "shutdown" if self._means.tasks.closing else "stop"

    def _holds(self, lease: Lease) -> bool:
        now = self._means.leases.of(self._axis)
        return now is not None and now.id == lease.id

    def _note(self, entry: dict[str, Any]) -> None:
        """Into the record of who commanded what."""
        self._means.audit.note(
            {
                "who": self._asker.name,
                "client": self._asker.address,
                "method": "WEBSOCKET",
                "path": f"{axis_path(self._axis)}/jog",
                **entry,
            }
        )


def _problem(error: ApiError | CanaxisError) -> ProblemReply:
    if isinstance(error, ApiError):
        return problems.of_api_error(error)
    return problems.of_driver_error(error)
