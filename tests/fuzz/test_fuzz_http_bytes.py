"""Bytes that are no good request, against a real server: refused, never a 500, never a hang."""

from __future__ import annotations

import socket
from pathlib import Path

import httpx
import pytest
from canaxis_processes import Running
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

pytestmark = [pytest.mark.process, pytest.mark.timeout(120)]

ANSWER = 10.0
"""Seconds within which a request that is whole was answered, or its connection closed."""
GET = b"GET /api/v1/nodes HTTP/1.1\r\nHost: %HOST%\r\nConnection: close\r\n"
POST = b"POST /api/v1/nodes/1/axes/0/move HTTP/1.1\r\nHost: %HOST%\r\nConnection: close\r\n"
JSON = b"Content-Type: application/json\r\n"
tokens = st.binary(max_size=30)
pieces = st.lists(
    st.sampled_from(
        (b"\r\n", b"\n", b":", b" ", b"\0", b"HTTP/1.1", b"HTTP/2.0", b"%ff%00", b"\xc3\x28", b"0\r\n\r\n")
    )
    | st.sampled_from(
        (b"Content-Length: ", b"Transfer-Encoding: chunked\r\n", b"Expect: 100-continue\r\n", b"-1", b"5")
    )
    | tokens,
    max_size=10,
).map(b"".join)
methods = st.sampled_from(
    (b"GET", b"POST", b"PUT", b"HEAD", b"OPTIONS", b"TRACE", b"CONNECT", b"PRI", b"get", b"\xff")
)
paths = st.sampled_from(
    (b"/", b"*", b"/api/v1/nodes", b"/api/v1/stop", b"/%", b"//", b"http://x/", b"/\xff", b"/" + b"a" * 9000)
)
requests = st.one_of(
    pieces,
    st.tuples(st.sampled_from((GET, POST, POST + JSON)), pieces)
    .map(b"".join)
    .map(lambda head: head + b"\r\n\r\n"),
    st.tuples(methods, st.just(b" "), paths | tokens, st.just(b" HTTP/1.1\r\nHost: %HOST%\r\n\r\n")).map(
        b"".join
    ),
    st.tuples(st.just(GET), tokens, st.just(b": "), tokens, st.just(b"\r\n\r\n")).map(b"".join),
    st.binary(max_size=64).map(lambda body: POST + JSON + b"Content-Length: %d\r\n\r\n" % len(body) + body),
)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> object:
    """A service without a bus: what it does with bytes does not need one."""
    folder: Path = tmp_path_factory.mktemp("http")
    folder.joinpath("canaxis.yaml").write_text(
        "bus: {interface: virtual, channel: nobody}\n", encoding="utf-8"
    )
    with Running(folder, "serve", "--port", "0") as service:
        found = service.until(r"http://(127\.0\.0\.1):(\d+)/api/v1")
        yield found[1], int(found[2])
        assert service.process.poll() is None, "the service lives"
        assert "Traceback" not in service.text


@settings(max_examples=80, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(request=requests)
@example(request=b"")
@example(request=b"\r\n" * 50)
@example(request=b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n")
@example(request=b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03")
@example(request=GET + b"X: " + b"a" * 100_000 + b"\r\n\r\n")
@example(request=GET + b"X: y\r\n" * 5_000 + b"\r\n")
@example(request=b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\nHost: %HOST%\r\n\r\n")
@example(request=GET + b"Host: other\r\n\r\n")
@example(request=GET + b"Last-Event-ID: \xff\r\nPrefer: \x80\r\n\r\n")
@example(request=POST + JSON + b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n")
@example(request=POST + JSON + b"Transfer-Encoding: chunked\r\n\r\nZZ\r\n\r\n")
@example(request=POST + JSON + b"Transfer-Encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFFF\r\n\r\n")
@example(request=POST + JSON + b"Content-Length: 99999999999999999999\r\n\r\n")
@example(request=POST + JSON + b"Idempotency-Key: \xff\xfe\r\nContent-Length: 2\r\n\r\n{}")
@example(request=POST + JSON + b"Content-Encoding: gzip\r\nContent-Length: 2\r\n\r\n\x1f\x8b")
def test_no_bytes_give_a_500_or_a_hang(address: tuple[str, int], request: bytes) -> None:
    host = f"{address[0]}:{address[1]}"
    answer = exchange(address, request.replace(b"%HOST%", host.encode()))
    for line in answer.split(b"\r\n"):
        if line.startswith(b"HTTP/1."):
            status = int(line.split()[1])
            assert status != 500, answer[:500]
            assert 100 <= status < 600
    assert httpx.get(f"http://{host}/livez", timeout=ANSWER).status_code == 200


def exchange(address: tuple[str, int], request: bytes) -> bytes:
    """Send it, say that nothing more comes, and read until the server closes."""
    answer = b""
    with socket.create_connection(address, timeout=ANSWER) as connection:
        try:
            connection.sendall(request)
            connection.shutdown(socket.SHUT_WR)
            while len(answer) < 1_000_000 and (some := connection.recv(65536)):
                answer += some
        except (ConnectionResetError, BrokenPipeError):
            pass  # it hung up before it had read all
    return answer
