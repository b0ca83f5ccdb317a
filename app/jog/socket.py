"""One client's connection: its messages in, acknowledgements and the axis's status out.

Nothing here keeps an axis turning: a hold that counts is passed on to the axis's own dead man. This side may
hang, or end at any point; the axis stops all the same.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from typing import TYPE_CHECKING, Any

import structlog
from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from app.access.schemas import Asker
from app.axes import views
from app.axes.schemas import Limits, Quantity
from app.axes.units import Scale
from app.http import problems, validation
from app.http.paths import operation_path
from app.http.problems import ApiError, ProblemReply
from app.http.rates import RateLimit
from app.http.schemas import Problem
from app.jog import schemas as messages
from app.jog.outbox import Outbox, Overflow
from app.jog.session import Hold, JogSession
from app.leases.book import LEASE, Lease
from app.leases.leases import LeaseEnd
from drivers.errors import AxisFault, CanaxisError
from drivers.master.axis.axis import Axis
from drivers.master.motions.jogging import Jog, JogEnd
from drivers.master.motions.motion import MotionKind, MotionState, Undertaking
from drivers.master.plan.requests import JogRequest, check_velocity

if TYPE_CHECKING:
    from app.service import Service

STATUS = 1 / 30
"""Seconds between two statuses while the axis moves."""
HOLDS_PER_SILENCE = 2.5
"""How many holds a client is asked for in the time for which one counts."""
PER_SECOND = 100.0
"""Messages that a client may send."""
HUNG = 5.0
"""Seconds that a client may take to take a message."""
CLOSING = 1.0
"""Seconds that closing the connection may take."""
TOO_MANY, TOO_SLOW, RESTART, UNKNOWN, REFUSED = 1008, 1013, 1012, 4404, 4503
"""Codes with which the connection is closed."""
LOSSES = frozenset({"leased", "lease_lost"})
"""Refusals of a hold by which its axis is somebody else's, or nobody's any more."""
PRESS_OVER = "It was let go before the axis could begin."

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis.jog")


class Closing(Exception):
    """The connection is to be closed, with this code."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code
        self.reason = reason


class _PressOver(Exception):
    """What was to begin is not wanted any more."""


class JogSocket:
    """Serves one WebSocket until it ends."""

    def __init__(self, service: Service, axis: Axis, websocket: WebSocket, asker: Asker) -> None:
        self._service = service
        self._axis = axis
        self._websocket = websocket
        self._asker = asker
        self._token = websocket.headers.get(LEASE)
        self._under: Lease | None = None
        """The lease of the axis when it was last held."""
        self._loop = asyncio.get_running_loop()
        self._opened = self._loop.time()
        self._silence = service.settings.server.jog_silence_ms / 1000
        self._session = JogSession(self._silence)
        self._outbox = Outbox()
        self._rate = RateLimit(PER_SECOND, self._loop.time)
        self._jog: Jog | None = None
        self._velocity = 0
        self._starts: set[asyncio.Task[None]] = set()
        self._end: asyncio.Future[Closing] = self._loop.create_future()

    def close(self, code: int, reason: str) -> None:
        """Have the connection closed soon."""
        if not self._end.done():
            self._end.set_result(Closing(code, reason))

    async def serve(self) -> None:
        """Speak with the client until either side ends it. Whatever it held is let go then."""
        await self._websocket.accept()
        self._outbox.put(self._hello)
        unwatch = self._service.leases.watch(self._on_lease_end)
        talk = [asyncio.ensure_future(self._listen()), asyncio.ensure_future(self._speak())]
        closing: Closing | None = None
        try:
            await asyncio.wait({*talk, self._end}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            unwatch()
            self._let_go()
            for task in talk:
                task.cancel()
            ends = await asyncio.gather(*talk, return_exceptions=True)
            await asyncio.gather(*self._starts)
        for end in ends:
            if isinstance(end, Closing):
                closing = end
            elif isinstance(end, Exception) and not isinstance(end, WebSocketDisconnect):
                log.error("a jog failed", error=repr(end))
                closing = Closing(1011, "internal_error")
        if closing is None and self._end.done():
            closing = self._end.result()
        if closing is not None:
            await close(self._websocket, closing.code, closing.reason)

    # --- what the client says ---

    async def _listen(self) -> None:
        while True:
            message = await self._websocket.receive()
            if message["type"] == "websocket.disconnect":
                return
            if self._rate.delay("") > 0:
                raise Closing(TOO_MANY, "too_many_requests")
            self._hear(message.get("text"))

    def _hear(self, text: str | None) -> None:
        """Act on a message, at once."""
        now = self._loop.time()
        try:
            said = messages.CLIENT_MESSAGES.validate_json(text or "")
        except ValidationError as error:
            items = [{**item, "loc": ("message", *item["loc"][1:])} for item in error.errors()]
            self._refuse(validation.of_validation(items))
            return
        match said:
            case messages.HoldMessage():
                self._hold(said, now)
            case messages.ReleaseMessage():
                self._session.release()
                if self._jog is not None:
                    self._jog.end(JogEnd.RELEASED)
            case messages.LeaseMessage():
                self._token = said.token
                try:
                    self._check_lease()
                except ApiError as error:
                    self._refuse(_problem(error))
            case messages.PingMessage():
                way = self._round_trip(said.echo, said.echo_age_ms, now)
                self._outbox.put(
                    lambda stamp: messages.PongMessage(stamp=stamp, sent=said.sent, round_trip_ms=_ms(way))
                )

    def _hold(self, hold: messages.HoldMessage, now: float) -> None:
        way = self._round_trip(hold.echo, hold.echo_age_ms, now)
        outcome: str
        try:
            self._velocity, acceleration = self._wanted(hold)
        except (ApiError, CanaxisError) as error:
            self._session.use_up()
            if self._jog is not None:
                lost = isinstance(error, ApiError) and error.type.code in LOSSES
                self._jog.end(JogEnd.LEASE if lost else JogEnd.RELEASED)
            self._refuse(_problem(error), hold.seq)
            outcome, counts = "refused", False
        else:
            became = self._session.hold(hold.seq, now, self._opened + hold.echo / 1000)
            outcome, counts = became.value, became.counts
            if became is Hold.BEGINS:
                self._begin(hold, acceleration)
            elif counts and self._jog is not None:
                self._jog.hold(self._velocity, now)
            if counts and way is not None and self._jog is not None:
                self._jog.note_round_trip(way)

        def ack(stamp: float) -> messages.AckMessage:
            position, velocity = self._where()
            return messages.AckMessage.model_validate(
                {
                    "stamp": stamp,
                    "seq": hold.seq,
                    "sent": hold.sent,
                    "counts": counts,
                    "outcome": outcome,
                    "round_trip_ms": _ms(way),
                    "jog": self._state(),
                    "position": position,
                    "velocity": velocity,
                }
            )

        self._outbox.acknowledge(ack)

    def _wanted(self, hold: messages.HoldMessage) -> tuple[int, int | None]:
        """Velocity and acceleration in steps. Raises `ApiError`, `BadValue`; the axis's lease is heeded."""
        self._check_lease()
        self._under = self._service.leases.of(self._axis)
        scale = Scale.named(hold.unit, self._axis.config)
        velocity = scale.steps("velocity", hold.velocity)
        check_velocity(velocity)
        return velocity, scale.rate("acceleration", hold.acceleration)

    def _check_lease(self) -> None:
        self._service.leases.check((self._axis,), self._token)

    def _round_trip(self, echo: float, age_ms: float, now: float) -> float | None:
        """Seconds there and back; None if the client's figures can't be."""
        way = now - self._opened - (echo + age_ms) / 1000
        return way if way >= 0 else None

    # --- pressing ---

    def _begin(self, hold: messages.HoldMessage, acceleration: int | None) -> None:
        task = asyncio.ensure_future(self._start(hold, acceleration))
        self._starts.add(task)
        task.add_done_callback(self._starts.discard)

    async def _start(self, hold: messages.HoldMessage, acceleration: int | None) -> None:
        asked = hold.model_dump(exclude_none=True, include={"velocity", "unit", "acceleration"})

        def begin(operation_id: str) -> Undertaking:
            if not self._session.begins(self._loop.time()):
                raise _PressOver
            self._check_lease()  # it may have ended while the record was written
            request = JogRequest(self._velocity, acceleration, self._silence)
            jog = self._axis.jog(request, held_at=self._session.held_at, undertaking_id=operation_id)
            self._jog = jog
            jog.watch(self._on_change)
            return jog

        entry: dict[str, Any] = {"body": asked}
        try:
            operation = await self._service.command(
                self._service.operations.start(
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
            self._refuse(reply, hold.seq)
            entry |= {"status": reply.status, "refused": reply.body["code"]}
        self._note(entry)

    def _on_lease_end(self, lease: Lease, _: LeaseEnd) -> None:
        if self._jog is not None and self._under is not None and self._under.id == lease.id:
            self._jog.end(JogEnd.LEASE)

    def _let_go(self) -> None:
        """The connection is over: nobody holds any more."""
        self._session.use_up()
        if self._jog is not None:
            self._jog.end(JogEnd.CLOSED)

    def _on_change(self, undertaking: Undertaking) -> None:
        jog = self._jog
        if jog is not undertaking or jog is None or not jog.done:
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
                    "result": self._service.operations.reply_for(jog).result,
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
        return "shutdown" if self._service.closing else "stop"

    def _holds(self, lease: Lease) -> bool:
        now = self._service.leases.of(self._axis)
        return now is not None and now.id == lease.id

    def _note(self, entry: dict[str, Any]) -> None:
        """Into the record of who commanded what."""
        self._service.audit.note(
            {
                "who": self._asker.name,
                "client": self._asker.address,
                "method": "WEBSOCKET",
                "path": f"{views.axis_path(self._axis)}/jog",
                **entry,
            }
        )

    # --- what is said ---

    async def _speak(self) -> None:
        told_at = self._opened
        while True:
            moves = self._jog is not None or self._axis.status.moving
            news = await self._waited(STATUS if moves else self._silence / HOLDS_PER_SILENCE)
            while news and (compose := self._outbox.take()) is not None:
                await self._send(compose(self._stamp()))
            if self._loop.time() - told_at >= STATUS:
                told_at = self._loop.time()
                await self._send(self._status(self._stamp()))

    async def _waited(self, seconds: float) -> bool:
        try:
            return await self._outbox.wait(seconds)
        except Overflow:
            raise Closing(TOO_SLOW, "too_slow") from None

    async def _send(self, message: messages.ServerMessage) -> None:
        try:
            async with asyncio.timeout(HUNG):
                await self._websocket.send_text(message.model_dump_json())
        except TimeoutError:
            raise Closing(TOO_SLOW, "too_slow") from None

    def _stamp(self) -> float:
        return math.floor((self._loop.time() - self._opened) * 1e6) / 1000  # never ahead of the clock

    def _refuse(self, reply: ProblemReply, seq: int | None = None) -> None:
        said = Problem.model_validate(reply.body)
        self._outbox.put(lambda stamp: messages.ProblemMessage(stamp=stamp, seq=seq, problem=said))

    def _hello(self, stamp: float) -> messages.HelloMessage:
        return messages.HelloMessage(
            stamp=stamp,
            axis=views.axis_status(self._axis, self._service.leases),
            keep_alive_ms=round(self._silence * 1000 / HOLDS_PER_SILENCE),
            silence_ms=round(self._silence * 1000),
        )

    def _status(self, stamp: float) -> messages.JogStatusMessage:
        status = self._axis.status
        position, velocity = self._where()
        return messages.JogStatusMessage(
            stamp=stamp,
            jog=self._state(),
            state=None if status.state is None else status.state.value,
            position=position,
            velocity=velocity,
            moving=status.moving,
            limits=Limits(negative=status.switches.negative_limit, positive=status.switches.positive_limit),
            stale=status.stale,
            operation=None if self._jog is None else operation_path(self._jog.id),
        )

    def _state(self) -> messages.JogState:
        if self._jog is not None:
            return "turning" if self._jog.held else "stopping"
        if self._session.busy:
            return "starting"
        return "used_up" if self._session.used_up else "idle"

    def _where(self) -> tuple[Quantity | None, Quantity | None]:
        status, scale = self._axis.status, Scale.of(self._axis.config)
        return (
            None if status.position is None else scale.quantity(status.position),
            None if status.velocity is None else scale.quantity(status.velocity, "/s"),
        )


async def close(websocket: WebSocket, code: int, reason: str) -> None:
    """Close the connection as far as the client takes that."""
    if websocket.application_state is not WebSocketState.CONNECTED:
        return
    with contextlib.suppress(TimeoutError, RuntimeError, OSError, WebSocketDisconnect):
        async with asyncio.timeout(CLOSING):
            await websocket.close(code, reason)


def _problem(error: ApiError | CanaxisError) -> ProblemReply:
    if isinstance(error, ApiError):
        return problems.of_api_error(error)
    return problems.of_driver_error(error)


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds * 1000, 3)
