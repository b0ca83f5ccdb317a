"""Large bodies on their way into a file: slow, without end, cut off, too many at once, a full disk."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Awaitable, Callable, Iterable
from pathlib import Path

import pytest
from starlette.types import Message, Receive, Scope, Send

from app.access.policy import Policy
from app.access.security import SecurityMiddleware
from app.access.tickets import Tickets
from app.configuration.configuration import ServerConfiguration
from app.http.paths import API
from app.http.replies import ClientGone, Refusal
from app.http.uploads import AT_ONCE, JSON, Uploads

pytestmark = pytest.mark.looptime

GONE: Message = {"type": "http.disconnect"}


def body(*pieces: bytes, pause: float = 0.0, end: Message | None = None) -> Receive:
    """What a client sends, piece by piece; then `end`, or the last piece for ever."""
    waiting = list(pieces)

    async def receive() -> Message:
        await asyncio.sleep(pause)
        if waiting:
            return {"type": "http.request", "body": waiting.pop(0), "more_body": bool(waiting or end)}
        if end is not None:
            return end
        return await asyncio.Future()

    return receive


def uploads(**more: float) -> Uploads:
    return Uploads(**{"max_bytes": 1000, "idle_timeout": 10.0, "total_timeout": 60.0, **more})


async def refused(taking: Awaitable[object]) -> tuple[int, str]:
    with pytest.raises(Refusal) as refusal:
        await taking
    return refusal.value.reply.status, str(refusal.value.reply.body["code"])


async def test_a_whole_body_is_in_the_file_from_its_beginning() -> None:
    taken = uploads()
    upload = await taken.take(body(b"ab", b"cd"), JSON, None)
    with upload.file:
        assert (upload.file.read(), upload.size, taken.running) == (b"abcd", 4, 0)


async def test_a_body_that_stands_still_or_trickles_for_ever_is_not_waited_for() -> None:
    taken = uploads()
    began = asyncio.get_running_loop().time()
    assert await refused(taken.take(body(b"a", b"b", pause=11), JSON, None)) == (408, "request_timeout")
    assert asyncio.get_running_loop().time() - began == pytest.approx(10)
    assert await refused(taken.take(body(*[b"a"] * 100, pause=9), JSON, None)) == (408, "request_timeout")
    assert asyncio.get_running_loop().time() - began == pytest.approx(70)
    assert taken.running == 0, "it holds no place any more"


async def test_a_body_that_is_too_long_is_not_taken_whatever_it_says_it_has() -> None:
    taken = uploads()
    asked = 0

    async def endless() -> Message:
        nonlocal asked
        asked += 1
        return {"type": "http.request", "body": bytes(400), "more_body": True}

    assert await refused(taken.take(endless, JSON, 5)) == (413, "body_too_large")
    assert asked == 3
    assert await refused(taken.take(endless, JSON, 1001)) == (413, "body_too_large")
    assert asked == 3, "not a byte was asked for"


async def test_so_many_come_at_once_at_most_and_a_place_is_free_again() -> None:
    taken = uploads()
    held = [asyncio.create_task(taken.take(body(b"a", b"b", pause=5), JSON, None)) for _ in range(AT_ONCE)]
    await asyncio.sleep(1)
    assert await refused(taken.take(body(b"a"), JSON, None)) == (429, "too_many_requests")
    for upload in await asyncio.gather(*held):
        upload.file.close()
    (await taken.take(body(b"a"), JSON, None)).file.close()


@pytest.mark.parametrize("nth", [0, 1])
async def test_a_full_disk_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, nth: int) -> None:
    """As the file is made, and as it is written."""
    make: Callable[..., object] = tempfile.TemporaryFile

    def full(**_: object) -> object:
        return make(dir=tmp_path / "none") if nth == 0 else Path("/dev/full").open("wb")

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    assert await refused(uploads().take(body(b"a"), JSON, None)) == (503, "no_room")


async def test_a_client_that_goes_half_way_has_commanded_nothing() -> None:
    with pytest.raises(ClientGone):
        await uploads().take(body(b"a", end=GONE), JSON, None)
    reached: list[Scope] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        del receive, send
        reached.append(scope)

    async def send(message: Message) -> None:
        raise AssertionError(message)

    guard = SecurityMiddleware(app, Policy.of(ServerConfiguration()), Tickets())
    headers: Iterable[tuple[bytes, bytes]] = [(b"host", b"localhost:8402"), (b"content-type", b"text/csv")]
    scope: Scope = {"type": "http", "method": "POST", "path": f"{API}/trajectories", "headers": headers}
    await guard(scope | {"state": {}}, body(b"t,stage.x[steps]\n0,0\n", end=GONE), send)
    assert reached == []
