"""All open connections that jog: so many at most, and none at the end."""

from __future__ import annotations

from collections.abc import Callable

from starlette.websockets import WebSocket

from app.access.schemas import Asker
from app.http.problems import ApiError, ProblemReply, of_api_error, of_driver_error
from app.http.schemas import Problem
from app.jog.pressing import Means
from app.jog.schemas import ProblemMessage
from app.jog.socket import REFUSED, RESTART, UNKNOWN, JogSocket, close
from drivers.errors import CanaxisError
from drivers.master.axis.axis import Axis


class Jogs:
    """Serves them."""

    def __init__(self, means: Means, limit: int) -> None:
        """`limit`: how many may be open at once."""
        self._means = means
        self._limit = limit
        self._open: set[JogSocket] = set()

    def __len__(self) -> int:
        return len(self._open)

    async def serve(self, websocket: WebSocket, find: Callable[[], Axis], asker: Asker) -> None:
        """Jog the axis that `find` gives, until the connection ends. What is refused is told first."""
        try:
            self._means.tasks.check_open()
            if len(self._open) >= self._limit:
                raise ApiError("too_many_streams", f"{self._limit} connections that jog are open already.")
            axis = find()
        except ApiError as error:
            await _turn_away(websocket, of_api_error(error), REFUSED)
            return
        except CanaxisError as error:
            await _turn_away(websocket, of_driver_error(error), UNKNOWN)
            return
        socket = JogSocket(self._means, axis, websocket, asker)
        self._open.add(socket)
        try:
            await socket.serve()
        finally:
            self._open.discard(socket)

    def close(self) -> None:
        """The service ends: let every client know."""
        for socket in self._open:
            socket.close(RESTART, "shutting_down")


async def _turn_away(websocket: WebSocket, reply: ProblemReply, code: int) -> None:
    """A browser sees no answer to a handshake that fails, so accept, say why, and close."""
    await websocket.accept()
    told = ProblemMessage(stamp=0, seq=None, problem=Problem.model_validate(reply.body))
    await websocket.send_text(told.model_dump_json())
    await close(websocket, code, str(reply.body["code"]))
