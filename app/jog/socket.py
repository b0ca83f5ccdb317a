"""One client's connection: its messages in, acknowledgements and the axis's status out."""

from __future__ import annotations

import asyncio
import contextlib
import math

import structlog
from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from app.access.schemas import Asker
from app.axes.views import axis_status
from app.http import validation
from app.http.parameters import LEASE
from app.http.rates import RateLimit
from app.jog import schemas as messages
from app.jog import views
from app.jog.outbox import Outbox, Overflow
from app.jog.pressing import Means, Pressing
from drivers.master.axis.axis import Axis

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

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis.jog")


class Closing(Exception):
    """The connection is to be closed, with this code."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code
        self.reason = reason


class JogSocket:
    """Serves one WebSocket until it ends."""

    def __init__(self, means: Means, axis: Axis, websocket: WebSocket, asker: Asker) -> None:
        self._leases = means.leases
        self._silence = means.silence
        self._axis = axis
        self._websocket = websocket
        self._loop = asyncio.get_running_loop()
        self._opened = self._loop.time()
        self._outbox = Outbox()
        self._pressing = Pressing(means, axis, asker, websocket.headers.get(LEASE), self._outbox)
        self._rate = RateLimit(PER_SECOND, self._loop.time)
        self._end: asyncio.Future[Closing] = self._loop.create_future()

    def close(self, code: int, reason: str) -> None:
        """Have the connection closed soon."""
        if not self._end.done():
            self._end.set_result(Closing(code, reason))

    async def serve(self) -> None:
        """Speak with the client until either side ends it. Whatever it held is let go then."""
        await self._websocket.accept()
        self._outbox.put(self._hello)
        unwatch = self._leases.watch(self._pressing.on_lease_end)
        talk = [asyncio.ensure_future(self._listen()), asyncio.ensure_future(self._speak())]
        closing: Closing | None = None
        try:
            await asyncio.wait({*talk, self._end}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            unwatch()
            self._pressing.let_go()
            for task in talk:
                task.cancel()
            ends = await asyncio.gather(*talk, return_exceptions=True)
            await self._pressing.begun()
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
            self._pressing.refuse(validation.of_validation(items))
            return
        match said:
            case messages.HoldMessage():
                way = self._round_trip(said.echo, said.echo_age_ms, now)
                self._pressing.hold(said, now, seen=self._opened + said.echo / 1000, way=way)
            case messages.ReleaseMessage():
                self._pressing.release()
            case messages.LeaseMessage():
                self._pressing.hold_under(said.token)
            case messages.PingMessage():
                way = self._round_trip(said.echo, said.echo_age_ms, now)
                self._outbox.put(
                    lambda stamp: messages.PongMessage(
                        stamp=stamp, sent=said.sent, round_trip_ms=views.ms(way)
                    )
                )

    def _round_trip(self, echo: float, age_ms: float, now: float) -> float | None:
        """Seconds there and back; None if the client's figures can't be."""
        way = now - self._opened - (echo + age_ms) / 1000
        return way if way >= 0 else None

    # --- what is said ---

    async def _speak(self) -> None:
        told_at = self._opened
        while True:
            moves = self._pressing.jog is not None or self._axis.status.moving
            news = await self._waited(STATUS if moves else self._silence / HOLDS_PER_SILENCE)
            while news and (compose := self._outbox.take()) is not None:
                await self._send(compose(self._stamp()))
            if self._loop.time() - told_at >= STATUS:
                told_at = self._loop.time()
                pressing = self._pressing
                await self._send(views.status(self._stamp(), self._axis, pressing.state, pressing.jog))

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

    def _hello(self, stamp: float) -> messages.HelloMessage:
        return messages.HelloMessage(
            stamp=stamp,
            axis=axis_status(self._axis, self._leases),
            keep_alive_ms=round(self._silence * 1000 / HOLDS_PER_SILENCE),
            silence_ms=round(self._silence * 1000),
        )


async def close(websocket: WebSocket, code: int, reason: str) -> None:
    """Close the connection as far as the client takes that."""
    if websocket.application_state is not WebSocketState.CONNECTED:
        return
    with contextlib.suppress(TimeoutError, RuntimeError, OSError, WebSocketDisconnect):
        async with asyncio.timeout(CLOSING):
            await websocket.close(code, reason)
