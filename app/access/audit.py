"""The record of who commanded what: a line in the log for every command, and in a file if one is set.

The file is written in a thread of its own from a bounded queue: whatever its disk does, no command waits.
What couldn't be written is counted, and said once in the log.
"""

from __future__ import annotations

import asyncio
import json
import logging
import queue
import sys
import threading
import time
from datetime import UTC, datetime
from io import TextIOWrapper
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any, cast

import structlog
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access.tokens import Principal, private
from app.configuration.configuration import AuditConfiguration
from app.http.paths import API, SAFE_METHODS

WAITING = 10_000
"""Lines that may wait for the disk."""
PATIENCE = 2.0
"""Seconds that the last lines get at the end."""
LONGEST = 4096
"""Bytes of a body that are looked at; no command needs more."""
_OPERATIONS = f"{API}/operations/"
_NOT_UNDERSTOOD = frozenset({400, 401, 403, 404, 405, 408, 413, 415, 421, 422, 429})
"""Answers after which the body isn't repeated: it may hold anything, even a token in the wrong place."""

log: structlog.stdlib.BoundLogger = structlog.get_logger("canaxis.audit")


class _File(RotatingFileHandler):
    """Lines in a file that only its owner can read; remembers why the last one wasn't written."""

    failure: str | None = None

    def _open(self) -> TextIOWrapper:
        return open(self.baseFilename, "a", encoding=self.encoding, opener=private)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        del record
        error = sys.exc_info()[1]
        self.failure = (error.strerror if isinstance(error, OSError) else None) or repr(error)


class AuditTrail:
    """Writes entries to the log, and to the file if there is one."""

    def __init__(self, configuration: AuditConfiguration) -> None:
        self.lost = 0
        """Entries that are not in the file."""
        self.problem: str | None = None
        """Why the file isn't written at the moment."""
        self._configuration = configuration
        self._queue: queue.Queue[str | None] = queue.Queue(WAITING)
        self._writer: threading.Thread | None = None

    def open(self) -> None:
        """Begin to write the file, if there is one."""
        if self._configuration.file is not None:
            write = threading.Thread(
                target=self._write, args=(self._configuration.file,), name="audit trail", daemon=True
            )
            write.start()
            self._writer = write

    async def close(self) -> None:
        """Let what waits be written, but not for long."""
        writer, self._writer = self._writer, None
        if writer is not None:
            try:
                self._queue.put_nowait(None)
            except queue.Full:
                return  # the disk hangs; the thread ends with the process
            await asyncio.to_thread(writer.join, PATIENCE)

    def note(self, entry: dict[str, Any]) -> None:
        """Keep an entry. Never waits, never raises."""
        log.info("command", **entry)
        if self._writer is None:
            return
        time_ = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        try:
            self._queue.put_nowait(json.dumps({"time": time_, **entry}))
        except queue.Full:
            self._failed("The disk doesn't keep up.")

    def _write(self, path: Path) -> None:
        """The thread's work."""
        file = _File(
            path,
            maxBytes=self._configuration.max_bytes,
            backupCount=self._configuration.keep,
            encoding="utf-8",
            delay=True,
        )
        while (line := self._queue.get()) is not None:
            file.failure = None
            file.emit(logging.LogRecord("audit", logging.INFO, "", 0, line, None, None))
            if file.failure is not None:
                self._failed(file.failure)
            elif self.problem is not None:
                self.problem = None
                log.info("the audit file is written again", lost=self.lost)
        file.failure = None
        try:
            file.close()
        except OSError as error:
            self._failed(error.strerror or repr(error))

    def _failed(self, reason: str) -> None:
        self.lost += 1
        if self.problem is None:
            log.error("the audit file can't be written; commands go on", reason=reason)
        self.problem = reason


class AuditMiddleware:
    """Notes every command, with its outcome, carried out or refused; stands before what may refuse it."""

    def __init__(self, app: ASGIApp, trail: AuditTrail) -> None:
        self.app = app
        self.trail = trail

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on; note what came of it."""
        if scope["type"] != "http" or scope["method"] in SAFE_METHODS:
            await self.app(scope, receive, send)
            return
        began = time.monotonic()
        body = bytearray()
        status = 0
        operation: str | None = None

        async def listen() -> Message:
            message = await receive()
            if len(body) <= LONGEST:
                body.extend(message.get("body", b"")[: LONGEST + 1])
            return message

        async def watch(message: Message) -> None:
            nonlocal status, operation
            if message["type"] == "http.response.start":
                status = message["status"]
                operation = _operation(message)
            await send(message)

        try:
            await self.app(scope, listen, watch)
        finally:
            principal: Principal | None = scope.get("state", {}).get("principal")
            client: tuple[str, int] | None = scope.get("client")
            entry = {
                "who": None if principal is None else principal.name,
                "client": client[0] if client else None,
                "method": scope["method"],
                "path": scope["path"][:300],
                "body": None if status in _NOT_UNDERSTOOD else _essentials(bytes(body)),
                "status": status or None,
                "operation": operation,
                "took_ms": round((time.monotonic() - began) * 1000, 1),
            }
            self.trail.note({key: value for key, value in entry.items() if value is not None})


def _operation(start: Message) -> str | None:
    """The operation that an answer speaks of in its Location."""
    for name, value in start.get("headers", ()):
        if name == b"location" and value.startswith(_OPERATIONS.encode()):
            return cast("bytes", value).decode("latin-1").removeprefix(_OPERATIONS)
    return None


def _essentials(body: bytes) -> object:
    """The body, if it is short JSON."""
    if not body or len(body) > LONGEST:
        return None
    try:
        return json.loads(body)
    except (ValueError, RecursionError):
        return None
