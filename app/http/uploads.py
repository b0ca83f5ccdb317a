"""Bodies that are too large to be held: put into a file piece by piece as they come, and hashed on the way.

So a client that vanishes half-way has commanded nothing, as with every other command, and a body of a million
points takes no memory. The file has no name on the disk.
"""

from __future__ import annotations

import asyncio
import hashlib
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, cast

from starlette.types import Receive

from app.http.paths import API
from app.http.problems import problem
from app.http.replies import ClientGone, Refusal

JSON, CSV = "application/json", "text/csv"
UPLOADS = {f"{API}/trajectories": (JSON, CSV)}
"""The paths with such bodies, and the content types that they take. None of them can be sent by a page of
elsewhere without being asked about first: a form sends neither.
"""
AT_ONCE = 4
"""Uploads that are taken at the same time."""
_PIECE = 1 << 20
"""Bytes that are gathered before they go to the file."""


@dataclass(slots=True)
class Upload:
    """A body in a file, whole."""

    file: BinaryIO
    media_type: str
    size: int
    digest: bytes
    """SHA-256"""


@dataclass(slots=True)
class Uploads:
    """What is taken, and how much of it."""

    max_bytes: int
    idle_timeout: float
    """Seconds from one piece to the next."""
    total_timeout: float
    """Seconds for all of it."""
    folder: Path | None = None
    """None: the system's for temporary files."""
    running: int = 0

    async def take(self, receive: Receive, media_type: str, declared: int | None) -> Upload:
        """The whole body. Raises `Refusal` as soon as it can't be taken, `ClientGone`."""
        if declared is not None and declared > self.max_bytes:
            raise self._too_large()
        if self.running >= AT_ONCE:
            raise Refusal(
                problem("too_many_requests", f"{AT_ONCE} uploads are under way already."),
                {"Retry-After": "5", "Connection": "close"},
            )
        self.running += 1
        try:
            async with asyncio.timeout(self.total_timeout):
                return await self._take(receive, media_type)
        except TimeoutError:
            raise Refusal(
                problem(
                    "request_timeout",
                    f"The body stood still for {self.idle_timeout:g} s, or took longer than "
                    f"{self.total_timeout:g} s.",
                ),
                {"Connection": "close"},
            ) from None
        except OSError as error:
            raise Refusal(
                problem("no_room", f"The body could not be put aside: {error.strerror or error}."),
                {"Connection": "close"},
            ) from error
        finally:
            self.running -= 1

    async def _take(self, receive: Receive, media_type: str) -> Upload:
        file = cast("BinaryIO", tempfile.TemporaryFile(dir=self.folder))  # noqa: SIM115 - the route closes it
        digest = hashlib.sha256()
        size = 0
        gathered = bytearray()
        try:
            while True:
                async with asyncio.timeout(self.idle_timeout):
                    message = await receive()
                if message["type"] == "http.disconnect":
                    raise ClientGone
                piece: bytes = message.get("body", b"")
                size += len(piece)
                if size > self.max_bytes:
                    raise self._too_large()
                gathered += piece
                last = not message.get("more_body", False)
                if last or len(gathered) >= _PIECE:
                    whole = bytes(gathered)
                    gathered.clear()
                    digest.update(whole)
                    if len(whole) > 65_536:  # a disk may make us wait
                        await asyncio.to_thread(file.write, whole)
                    else:
                        file.write(whole)
                if last:
                    file.seek(0)
                    return Upload(file, media_type, size, digest.digest())
        except BaseException:
            file.close()
            raise

    def _too_large(self) -> Refusal:
        return Refusal(
            problem(
                "body_too_large",
                f"The body is larger than {self.max_bytes} bytes.",
                hint="Send fewer points, or raise trajectories.max_bytes.",
            ),
            {"Connection": "close"},
        )
