"""Fixtures for the tests of programs that move axes: simulated modules, and the service, in pytest's hands.

Switch them on with ``pytest_plugins = ["canaxis.testing"]`` in the conftest.py at the top of your tests.
Modules and service are processes of their own, which end with the test session however that ends: your tests
import nothing of theirs, so that packages of yours may be called `app` or `drivers` as well. Needs pytest,
and the extra `server` for what is started. docs/testing-with-the-simulator.md shows them at work.

A conftest.py may import from here as well: nothing here is for pytest to rewrite (PYTEST_DONT_REWRITE).
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager

import pytest

from canaxis.testing.panel import Panel
from canaxis.testing.processes import NotStarted
from canaxis.testing.running import RunningService, SimulatedPort, serve, simulate
from canaxis.testing.states import AxisState, ModuleState, WatchState, WireFault

__all__ = [
    "AxisState",
    "ModuleState",
    "NotStarted",
    "Panel",
    "RunningService",
    "SimulatedPort",
    "WatchState",
    "WireFault",
    "serve",
    "simulate",
]


@pytest.fixture
def simulated_nodes() -> tuple[int, ...]:
    """The node IDs on `simulated_port`: just 1. Override or parametrize it to have others."""
    return (1,)


@pytest.fixture
def simulated_model() -> str:
    """What is simulated: a TMCM-3216. Override it to simulate another model."""
    return "TMCM-3216"


@pytest.fixture
def canaxis_settings() -> Mapping[str, object]:
    """Settings of `canaxis_service`, as in canaxis.yaml: none. Override it to have axes in mm, say."""
    return {}


@pytest.fixture
def simulated_port(simulated_nodes: tuple[int, ...], simulated_model: str) -> Iterator[SimulatedPort]:
    """New simulated modules behind a socketcand server at `host` and `port`, in real time.

    Any program can join: with python-can ``can.Bus(interface="socketcand", host=..., port=...,
    channel="can0")``. Act on the modules with ``simulated_port.panel(1).perform("press_switch", axis=0,
    switch="home")``.
    """
    with _or_failed(), simulate(*simulated_nodes, model=simulated_model) as port:
        yield port


@pytest.fixture
def canaxis_service(
    simulated_port: SimulatedPort, canaxis_settings: Mapping[str, object]
) -> Iterator[RunningService]:
    """A service on `simulated_port`, once it can command every module; with its `url` and a `client`."""
    with _or_failed(), serve(simulated_port, canaxis_settings) as service:
        yield service


@contextmanager
def _or_failed() -> Generator[None]:
    """What prevents a start is told in its own words, without a traceback through this package."""
    try:
        yield
    except NotStarted as error:
        pytest.fail(str(error), pytrace=False)
