"""The command line as a user has it: what starts, what refuses to, and what stays behind (nothing)."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import httpx
import pytest
from canaxis_processes import JSON, Canaxis, Running, simulator_and_service, until_ready

from drivers.bus.frame import Frame
from drivers.bus.pythoncan import PythonCanBus
from drivers.cia301.objects import Address
from drivers.cia301.sdo import Done, SdoUpload

pytestmark = [pytest.mark.process, pytest.mark.timeout(120)]

FAR = {"target": 900_000, "unit": "steps", "velocity": 50_000, "acceleration": 200_000}


@pytest.fixture
def taken_port() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def refused(directory: Path, *arguments: str) -> str:
    """What `canaxis` says as it refuses to start: a line or two, and never a traceback."""
    with Running(directory, *arguments) as canaxis:
        assert canaxis.ended() == 2
        assert "Traceback" not in canaxis.text
        assert len(canaxis.text.strip().splitlines()) <= 3
        return canaxis.text


def test_a_taken_port_is_told_in_a_line(tmp_path: Path, taken_port: int) -> None:
    assert f"127.0.0.1:{taken_port}" in refused(tmp_path, "serve", "--port", str(taken_port))
    assert f"127.0.0.1:{taken_port}" in refused(tmp_path, "simulate", "--port", str(taken_port))


def test_another_address_needs_a_token(tmp_path: Path) -> None:
    assert "token" in refused(tmp_path, "serve", "--host", "0.0.0.0", "--port", "0")


def test_a_wrong_setting_is_named(tmp_path: Path) -> None:
    (tmp_path / "canaxis.yaml").write_text("server: {prot: 1}", encoding="utf-8")
    assert "server.prot: no such setting" in refused(tmp_path, "serve", "--port", "0")
    assert "no-such-model" in refused(tmp_path, "simulate", "--model", "no-such-model")


def test_the_document_is_the_same_every_time(tmp_path: Path) -> None:
    for name in ("one.json", "two.json"):
        with Running(tmp_path, "openapi", "--output", name) as canaxis:
            assert canaxis.ended() == 0, canaxis.text
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()


def test_the_demo_starts_moves_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    with Running(tmp_path, "demo", "--port", "0", "--can-port", "0") as demo:
        url = demo.until(r"API +(http://127\.0\.0\.1:\d+)/api/v1")[1]
        for words in ("/docs", "/api/v1/events", "curl"):
            assert words in demo.text
        simulator = child_of(demo)
        with httpx.Client(base_url=url, timeout=30) as http:
            assert http.post("/api/v1/nodes/1/axes/0/enable", headers=JSON).status_code == 200
            assert http.post("/api/v1/nodes/1/axes/0/move", json=FAR).status_code == 202
            os.killpg(demo.process.pid, signal.SIGINT)  # as a terminal does
            assert demo.ended() == 0, demo.text
        assert "Axes stopped and disabled" in demo.text
        assert "Traceback" not in demo.text
        assert gone(simulator)


def test_a_killed_demo_leaves_no_simulator_behind(tmp_path: Path) -> None:
    with Running(tmp_path, "demo", "--port", "0", "--can-port", "0") as demo:
        demo.until("Ctrl-C ends both")
        simulator = child_of(demo)
        demo.signal(signal.SIGKILL)
        demo.ended()
        assert gone(simulator)


async def test_sigterm_in_mid_move_leaves_the_axes_standing_and_disabled(tmp_path: Path) -> None:
    with simulator_and_service(tmp_path) as (can_port, service, http):
        for axis in ("0", "1"):
            assert http.post(f"/api/v1/nodes/1/axes/{axis}/enable", headers=JSON).status_code == 200
            assert http.post(f"/api/v1/nodes/1/axes/{axis}/move", json=FAR).status_code == 202
        with http.stream("GET", "/api/v1/events") as stream:
            next(stream.iter_lines())
            service.signal(signal.SIGTERM)
            assert service.ended() == 0, service.text
        bus = PythonCanBus("socketcand", "can0", port=can_port)
        await bus.open()
        try:
            for axis in (0, 1):
                statusword = int.from_bytes(await read(bus, 0x6041 + 0x800 * axis), "little")
                assert statusword & 0x4F == 0x40, "switch on disabled"
                assert int.from_bytes(await read(bus, 0x606C + 0x800 * axis), "little") == 0
        finally:
            await bus.close()


async def read(bus: PythonCanBus, index: int) -> bytes:
    """Read an object of node 1 with nothing but a frame and its answer."""
    answer: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()

    def on_frames(frames: Sequence[Frame]) -> None:
        for frame in frames:
            if frame.cob_id == 0x581 and not answer.done():
                answer.set_result(frame.data)

    end = bus.subscribe(on_frames)
    transfer = SdoUpload(Address(index, 0))
    bus.send(Frame(0x601, transfer.request()))
    try:
        step = transfer.feed(await asyncio.wait_for(answer, 5))
    finally:
        end()
    assert isinstance(step, Done)
    return step.data


def test_a_second_signal_does_not_wait(tmp_path: Path) -> None:
    with simulator_and_service(tmp_path) as (_, service, http):
        http.post("/api/v1/nodes/1/axes/0/enable", headers=JSON)
        http.post("/api/v1/nodes/1/axes/0/move", json=FAR | {"acceleration": 5_000, "deceleration": 5_000})
        until_moving(http)
        service.signal(signal.SIGINT)
        until_deaf(http)
        service.signal(signal.SIGINT)
        began = time.monotonic()
        service.ended()
        assert time.monotonic() - began < 5


def test_the_service_starts_before_its_bus_and_finds_it(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with Running(tmp_path, "serve", "--option", f"port={port}", "--port", "0") as service:
        url = service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1]
        with httpx.Client(base_url=url, timeout=30) as http:
            ready = http.get("/readyz")
            assert ready.status_code == 503
            assert "bus" in ready.json()["reasons"][0]
            with Running(tmp_path, "simulate", "--port", str(port)):
                until_ready(http)


def started_with(sighup: str) -> tuple[str, str]:
    """`canaxis` as a program whose parent left it this disposition of SIGHUP, whatever ours is."""
    return (
        "-c",
        f"import signal; signal.signal(signal.SIGHUP, signal.{sighup}); import app.cli; app.cli.main()",
    )


def test_a_closed_terminal_ends_it_as_ctrl_c_does(tmp_path: Path) -> None:
    program = started_with("SIG_DFL")
    with Running(tmp_path, "serve", "--option", "port=9", "--port", "0", program=program) as service:
        service.until(r"http://127\.0\.0\.1:\d+/api/v1")
        service.signal(signal.SIGHUP)
        assert service.ended() == 0, service.text


def test_under_nohup_it_outlives_its_terminal(tmp_path: Path) -> None:
    program = started_with("SIG_IGN")
    with Running(tmp_path, "serve", "--option", "port=9", "--port", "0", program=program) as service:
        url = service.until(r"(http://127\.0\.0\.1:\d+)/api/v1")[1]
        service.signal(signal.SIGHUP)
        assert httpx.get(f"{url}/livez").status_code == 200
        assert "shutting down" not in service.text
        service.signal(signal.SIGTERM)
        assert service.ended() == 0, service.text


def test_what_no_http_library_sends_is_refused_or_understood(tmp_path: Path) -> None:
    with Running(tmp_path, "serve", "--option", "port=9", "--port", "0") as service:
        port = int(service.until(r"http://127\.0\.0\.1:(\d+)/api/v1")[1])

        def said(head: str) -> str:
            """What comes back until the server hangs up, or for a stream: its beginning."""
            with socket.create_connection(("127.0.0.1", port), 10) as client:
                with contextlib.suppress(ConnectionError):
                    client.sendall(head.replace("PORT", str(port)).encode())
                answer = b""
                with contextlib.suppress(ConnectionError):
                    while b"event: snapshot" not in answer and (chunk := client.recv(65536)):
                        answer += chunk
            return answer.decode()

        ours, end = "Host: 127.0.0.1:PORT\r\n", "Connection: close\r\n\r\n"
        assert " 200 " in said(f"GET /livez HTTP/1.1\r\n{ours}{end}").splitlines()[0]
        assert " 200 " in said(f"GET http://127.0.0.1:PORT/livez HTTP/1.1\r\n{ours}{end}").splitlines()[0]
        for head in (
            f"GET /livez HTTP/1.1\r\n{end}",
            "GET /livez HTTP/1.0\r\n\r\n",
            f"GET /livez HTTP/1.1\r\n{ours}Host: evil.example\r\n{end}",
            f"GET http://127.0.0.1:PORT/livez HTTP/1.1\r\nHost: evil.example\r\n{end}",
            f"GET /api/v1/events HTTP/1.1\r\nHost: evil.example:PORT\r\n{end}",
        ):
            assert " 421 " in said(head).splitlines()[0], head
        old = said(f"GET /api/v1/events HTTP/1.0\r\n{ours}\r\n")
        assert " 200 " in old.splitlines()[0]
        assert "retry: 2000\n\nid: " in old, (
            "uvicorn sends it in chunks all the same, which proxies understand"
        )
        escaped = said(f"GET /docs/assets/../../api/v1/nodes HTTP/1.1\r\n{ours}{end}")
        assert " 404 " in escaped.splitlines()[0]
        assert " 400 " in said(f"FOO / HTTP/1.1\r\n{ours}{end}").splitlines()[0]
        long = said(f"GET /livez HTTP/1.1\r\n{ours}X: {'x' * 1_000_000}")
        assert not long or " 400 " in long.splitlines()[0], "a head without an end is not collected for ever"
        assert " 200 " in said(f"GET /livez HTTP/1.1\r\n{ours}{end}").splitlines()[0]


def test_a_client_that_vanishes_in_mid_request_stops_nothing(tmp_path: Path) -> None:
    with simulator_and_service(tmp_path) as (_, _, http):
        http.post("/api/v1/nodes/1/axes/0/enable", headers=JSON)
        body = json.dumps({"target": 40_000, "unit": "steps"}).encode()
        head = (
            f"POST /api/v1/nodes/1/axes/0/move?wait=60 HTTP/1.1\r\nHost: {http.base_url.netloc.decode()}\r\n"
            f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
        )
        with socket.create_connection((str(http.base_url.host), http.base_url.port or 80)) as client:
            client.sendall(head.encode() + body)
            until_moving(http)
        [operation] = http.get("/api/v1/operations").json()["operations"]
        ended = http.get(f"/api/v1/operations/{operation['id']}?wait=30").json()
        assert ended["state"] == "succeeded"
        again = http.post("/api/v1/nodes/1/axes/0/move?wait=30", json={"target": 0, "unit": "steps"})
        assert again.json()["state"] == "succeeded"


def until_moving(http: httpx.Client) -> None:
    deadline = time.monotonic() + 10
    while not http.get("/api/v1/nodes/1/axes/0").json()["moving"]:
        assert time.monotonic() < deadline
        time.sleep(0.02)


def until_deaf(http: httpx.Client) -> None:
    """Wait until the service takes no new connection: it is shutting down."""
    deadline = time.monotonic() + 10
    with contextlib.suppress(OSError):
        while time.monotonic() < deadline:
            socket.create_connection((str(http.base_url.host), http.base_url.port or 80)).close()
            time.sleep(0.02)


def child_of(canaxis: Canaxis) -> int:
    """The process ID of the simulator that a demo started."""
    found = subprocess.run(
        ["ps", "--ppid", str(canaxis.process.pid), "-o", "pid="], capture_output=True, text=True, check=True
    )
    return int(found.stdout.split()[0])


def gone(pid: int, within: float = 10.0) -> bool:
    """Whether a process ends in time."""
    deadline = time.monotonic() + within
    while time.monotonic() < deadline:
        try:
            os.kill(pid, 0)
            with open(f"/proc/{pid}/stat", encoding="ascii") as stat:
                if stat.read().rpartition(")")[2].split()[0] == "Z":
                    return True
        except (ProcessLookupError, FileNotFoundError):
            return True
        time.sleep(0.05)
    return False


def test_scan_lists_who_is_there_and_what_it_is(tmp_path: Path) -> None:
    with Running(tmp_path, "simulate", "--port", "0", "--nodes", "3,90") as simulator:
        port = simulator.until(r"listens on 127\.0\.0\.1:(\d+)")[1]
        with Running(tmp_path, "scan", "--option", f"port={port}") as scan:
            assert scan.ended() == 0
            lines = [line.split() for line in scan.text.strip().splitlines()[1:]]
    assert [(line[0], line[1], line[-1]) for line in lines] == [
        ("3", "TMCM-3216", "TMCM-3216"),
        ("90", "TMCM-3216", "TMCM-3216"),
    ]


def test_scan_without_a_bus_says_so(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    assert "nothing listens" in refused(tmp_path, "scan", "--option", f"port={port}")
