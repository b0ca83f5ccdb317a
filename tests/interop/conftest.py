"""The other side of every interop test: a `canaxis simulate` process, and PyPI canopen on the same bus."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator

import canopen
import pytest


def free_port() -> int:
    """Ask the kernel for a TCP port that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def simulator_port() -> Iterator[int]:
    """A simulated module in a process of its own; gives the port of its socketcand server."""
    port = free_port()
    command = [sys.executable, "-m", "app", "simulate", "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if str(port) in line:
                break
        else:
            pytest.fail(f"{command} ended with {process.wait()} before it listened")
        yield port
    finally:
        process.terminate()
        process.wait(timeout=10)
        process.stdout.close()


@pytest.fixture
def peer(simulator_port: int) -> Iterator[canopen.RemoteNode]:
    """The simulated module as PyPI canopen's master sees it, operational."""
    network = canopen.Network()
    network.connect(interface="socketcand", host="127.0.0.1", port=simulator_port, channel="can0")
    try:
        node = canopen.RemoteNode(1, canopen.ObjectDictionary())
        network.add_node(node)
        node.sdo.RESPONSE_TIMEOUT = 2
        node.nmt.state = "OPERATIONAL"
        yield node
    finally:
        network.disconnect()
