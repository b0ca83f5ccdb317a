"""`canaxis serve` on a real SocketCAN link, as it stands, with those on it whom a lab may have there."""

from __future__ import annotations

import contextlib
import json
import os
import pathlib
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import canopen
import httpx
import pytest
from canaxis_processes import JSON, Running, until_ready
from canopen.sdo.base import SdoRecord
from repository import ROOT

import drivers.devices

pytestmark = [pytest.mark.socketcan, pytest.mark.process, pytest.mark.timeout(300)]

CHANNEL = "vcan0"

if not pathlib.Path(f"/sys/class/net/{CHANNEL}").exists():
    pytest.skip(f"there is no {CHANNEL} here", allow_module_level=True)
if os.geteuid() != 0:
    pytest.skip(f"only root may take {CHANNEL} down and up", allow_module_level=True)

ON_BUS = ("--interface", "socketcan", "--channel", CHANNEL)
EDS = Path(drivers.devices.__file__).with_name("data") / "tmcm_3216.eds"
LOCAL_NODE = ROOT / "tests" / "interop" / "local_node.py"
PATIENT = "network: {consumer_ms: 5000, node_heartbeat_ms: 2000, sender_process: false}\n"
"""A kernel within a kernel on a shared core is slow; what time-outs give is tested on a virtual clock. A
user-mode kernel may panic where a service with threads starts a process; the sender's process on such a link
has its own test, `test_socketcan_sender.py`.
"""
STARTING = 100.0
"""Seconds that a process may take to start there."""
URL = r"(http://127\.0\.0\.1:\d+)/api/v1"
AXIS = "/api/v1/nodes/1/axes/0"
FAR = {"target": 20_000_000, "unit": "steps", "velocity": 50_000, "acceleration": 200_000}


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With the settings in it; without them the service has one node with ID 1."""
    directory = tmp_path_factory.mktemp("lab")
    (directory / "canaxis.yaml").write_text(PATIENT)
    return directory


@pytest.fixture(scope="module")
def service(directory: Path) -> Iterator[httpx.Client]:
    """One service for all these tests: what happens at the other end of the link is not its end."""
    with (
        Running(directory, "serve", *ON_BUS, "--port", "0") as service,
        httpx.Client(base_url=service.until(URL, STARTING)[1], timeout=60) as http,
    ):
        yield http


@contextmanager
def peer(command: list[str]) -> Iterator[subprocess.Popen[str]]:
    """Somebody else on the bus, who says something once he is there."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline(), "it did not start"
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def simulator(directory: Path, service: httpx.Client) -> Iterator[None]:
    """`canaxis simulate` on the same link, taken in by the service; nothing is left of an earlier module."""
    with Running(directory, "simulate", *ON_BUS) as simulator:
        simulator.until(f"listens on socketcan:{CHANNEL}", STARTING)
        until(service, lambda: node(service)["state"] == "operational")
        until_ready(service)
        yield


def until(http: httpx.Client, condition: Callable[[], object], within: float = 100.0) -> None:
    deadline = time.monotonic() + within
    while not condition():
        assert time.monotonic() < deadline, (http.get("/readyz").text, http.get(AXIS).text)
        time.sleep(0.05)


def node(http: httpx.Client) -> dict[str, Any]:
    return http.get("/api/v1/nodes/1").json()


def enable(http: httpx.Client, axis: str = AXIS) -> None:
    response = http.post(f"{axis}/enable", headers=JSON)
    assert response.status_code == 200, response.text


def moved(http: httpx.Client, target: int, axis: str = AXIS, **more: Any) -> dict[str, Any]:
    """A move, to its end."""
    response = http.post(f"{axis}/move?wait=60", json={"target": target, "unit": "steps", **more})
    assert response.status_code == 200, response.text
    return response.json()


def set_moving(http: httpx.Client) -> dict[str, Any]:
    enable(http)
    operation = http.post(f"{AXIS}/move", json=FAR).json()
    until(http, lambda: http.get(AXIS).json()["moving"])
    return operation


def counters(http: httpx.Client) -> dict[str, int]:
    return http.get("/api/v1/bus").json()["counters"]


def tool(*command: str) -> subprocess.CompletedProcess[str]:
    """One of can-utils, or of iproute2."""
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)


@pytest.mark.usefixtures("simulator")
def test_three_axes_of_a_simulated_module_are_driven(service: httpx.Client) -> None:
    axes = [f"/api/v1/nodes/1/axes/{number}" for number in range(3)]
    for number, axis in enumerate(axes):
        enable(service, axis)
        assert moved(service, 1000 * (number + 1), axis)["state"] == "succeeded"
    assert [service.get(axis).json()["position"]["steps"] for axis in axes] == [1000, 2000, 3000]
    set_moving(service)
    assert service.post(f"{AXIS}/stop", headers=JSON).json()["moving"] is False
    assert service.post("/api/v1/stop").json()["complete"] is True
    service.post("/api/v1/stop/reset", headers=JSON)


@pytest.mark.usefixtures("simulator")
def test_axes_move_together_and_follow_a_path(service: httpx.Client) -> None:
    axes = [f"/api/v1/nodes/1/axes/{number}" for number in range(3)]
    for axis in axes:
        enable(service, axis)
    names = [{"node": 1, "axis": number, "unit": "steps"} for number in range(3)]
    ends = (2000, -3000, 500)
    targets = [name | {"target": target} for name, target in zip(names, ends, strict=True)]
    together = service.post("/api/v1/moves?wait=60", json={"targets": targets}).json()
    assert together["state"] == "succeeded", together
    points = [
        {"t": t, "positions": [end + share for end in ends]}
        for t, share in ((0, 0), (0.5, 40), (1.0, 200), (1.5, 360), (2.0, 400))
    ]
    path = {"axes": names, "cycle_ms": 20, "points": points}
    followed = service.post("/api/v1/trajectories?wait=60", json=path).json()
    assert followed["state"] == "succeeded", followed
    assert [service.get(axis).json()["position"]["steps"] for axis in axes] == [end + 400 for end in ends]
    for axis in axes:
        service.post(f"{axis}/disable", headers=JSON)


@pytest.mark.usefixtures("simulator")
def test_candump_sees_our_heartbeat_and_each_axis_s_status(service: httpx.Client) -> None:
    seen = tool("candump", "-L", "-n", "3", f"{CHANNEL},77F:7FF").stdout.split()
    assert [frame for frame in seen if "#" in frame] == ["77F#05"] * 3
    for cob_id in ("181", "1FE", "1FD"):
        frame = tool("candump", "-L", "-n", "1", f"{CHANNEL},{cob_id}:7FF").stdout.split()[-1]
        assert frame.startswith(f"{cob_id}#5002"), "statusword 0250h: switch on disabled, voltage there"


@pytest.mark.usefixtures("simulator")
def test_link_down_in_mid_move_and_up_again_needs_no_restart(service: httpx.Client) -> None:
    operation = set_moving(service)
    tool("ip", "link", "set", CHANNEL, "down")
    try:
        until(service, lambda: service.get("/readyz").status_code == 503)
        assert service.get("/readyz").json()["reasons"][0].startswith("The bus is down")
        failed = service.get(f"{operation['links']['self']}?wait=10").json()
        assert (failed["state"], failed["error"]["status"]) == ("failed", 503)
        refused = service.post(f"{AXIS}/stop", headers=JSON)
        assert (refused.status_code, "unknown" in refused.json()["detail"]) == (503, True)
        time.sleep(5.5)  # 1016h: by now the module has stopped its motor
    finally:
        tool("ip", "link", "set", CHANNEL, "up")
    until_ready(service)
    found = service.get(AXIS).json()
    assert (found["state"], found["moving"]) == ("fault", False), "nothing is reset by itself"
    assert service.post(f"{AXIS}/reset-fault", headers=JSON).status_code == 200
    enable(service)
    assert moved(service, 100, relative=True)["state"] == "succeeded"


@pytest.mark.usefixtures("simulator")
def test_a_second_master_that_reads_the_same_node_disturbs_nothing(service: httpx.Client) -> None:
    """The answers to it reach us, and must never be taken for ours."""
    network = canopen.Network()
    network.connect(interface="socketcan", channel=CHANNEL)
    try:
        other = canopen.RemoteNode(1, str(EDS))
        network.add_node(other)
        identity = other.sdo[0x1018]
        assert isinstance(identity, SdoRecord)
        enable(service)
        operation = service.post(f"{AXIS}/move", json=FAR).json()
        before = node(service)["counters"]["sdo"]
        for _ in range(20):
            answer = service.get("/api/v1/nodes/1/objects/0x1018/2")
            assert answer.json()["value"] == 3216, answer.text
            with contextlib.suppress(
                canopen.SdoCommunicationError
            ):  # it takes our answers for its own, and says so
                assert identity[1].raw == 0x286
        going = service.get(operation["links"]["self"]).json()
        assert going["state"] == "running", going["error"]
        after = node(service)["counters"]["sdo"]
        assert after["late"] + after["foreign"] > before["late"] + before["foreign"]
        assert service.post(f"{AXIS}/stop", headers=JSON).json()["moving"] is False
    finally:
        network.disconnect()


@pytest.mark.usefixtures("simulator")
def test_a_stop_is_served_under_a_flood_of_frames(service: httpx.Client) -> None:
    set_moving(service)
    before = counters(service)
    flood = subprocess.Popen(["cangen", CHANNEL, "-e", "-g", "1", "-L", "8"], stdout=subprocess.DEVNULL)
    odd = subprocess.Popen(["cangen", CHANNEL, "-I", "7F0", "-g", "1", "-L", "r"], stdout=subprocess.DEVNULL)
    try:
        until(service, lambda: counters(service)["extended_frames"] > before["extended_frames"] + 1000)
        stopped = service.post(f"{AXIS}/stop", headers=JSON)
        assert stopped.status_code == 200, stopped.text
        assert stopped.json()["moving"] is False
        assert counters(service)["unrouted"] > before["unrouted"]
    finally:
        for process in (flood, odd):
            process.kill()
            process.wait()
    until_ready(service)
    enable(service)
    assert moved(service, 100, relative=True)["state"] == "succeeded"


@pytest.mark.usefixtures("simulator")
def test_odd_frames_of_other_tools_are_counted_and_change_nothing(service: httpx.Client) -> None:
    enable(service)
    before, bus = node(service)["counters"], counters(service)
    for frame in (
        "701#0505",
        "701#R",
        "081#00",
        "081#0102030405060708",
        "181#37",
        "581#60",
        "581#R",
        "000#",
        "080#",
    ):
        tool("cansend", CHANNEL, frame)
    tool("cansend", CHANNEL, "1FFFFFFF#00")
    until(service, lambda: counters(service)["extended_frames"] > bus["extended_frames"])
    after = node(service)["counters"]
    for name in ("malformed_heartbeats", "malformed_emergencies", "short_pdos"):
        assert after[name] > before[name], name
    assert after["sdo"]["malformed"] > before["sdo"]["malformed"]
    assert service.get("/readyz").json()["ready"] is True
    assert moved(service, 100, relative=True)["state"] == "succeeded"


@pytest.mark.usefixtures("simulator")
def test_a_foreign_nmt_command_in_mid_move_is_noticed_and_the_node_taken_in_again(
    service: httpx.Client,
) -> None:
    operation = set_moving(service)
    tool("cansend", CHANNEL, "000#8000")  # Pre-operational, everybody
    failed = service.get(f"{operation['links']['self']}?wait=30").json()
    assert failed["state"] == "failed"
    assert failed["error"]["hint"]
    until_ready(service)
    until(service, lambda: not service.get(AXIS).json()["moving"])


def test_a_node_of_pypi_canopen_is_driven(service: httpx.Client) -> None:
    command = [sys.executable, str(LOCAL_NODE), str(EDS), "interface=socketcan", f"channel={CHANNEL}"]
    with peer(command):
        until(
            service, lambda: node(service)["state"] == "operational" and not service.get(AXIS).json()["stale"]
        )
        assert node(service)["identity"]["product_code"] == "0x00000C90"
        assert service.get(AXIS).json()["state"] == "switch_on_disabled", "never enabled by itself"
        enable(service)
        done = moved(service, 1234)
        assert (done["state"], done["result"]["position"]["steps"]) == ("succeeded", 1234), done
        stopped = service.post(f"{AXIS}/stop", headers=JSON)
        assert stopped.status_code == 200, stopped.text
        failed = moved(service, 666)
        assert failed["state"] == "failed"
        assert "8611" in json.dumps(failed["error"])
        listed = service.get("/api/v1/nodes/1/emergencies").json()["emergencies"]
        assert listed[0]["code"] == "0x8611"
        assert service.post(f"{AXIS}/reset-fault", headers=JSON).status_code == 200
        assert service.post(f"{AXIS}/disable", headers=JSON).json()["state"] == "switch_on_disabled"
    until(service, lambda: node(service)["state"] == "lost")
    assert service.get("/readyz").status_code == 503
