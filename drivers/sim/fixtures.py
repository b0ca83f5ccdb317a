"""Fixtures for the tests of programs that talk to the module: the simulator, in pytest's hands.

Switch them on with ``pytest_plugins = ["drivers.sim.fixtures"]`` in the conftest.py at the top of your tests.
``simulated_module`` is for asyncio code in this process, ``simulated_port`` for any program. pytest is needed
for this file only, and not installed with the package.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TypeAlias

import pytest

from drivers.devices.catalog import Catalog
from drivers.devices.profile import DeviceProfile
from drivers.sim.background import BackgroundStation
from drivers.sim.station import MODEL, Listen, Station

MakeStation: TypeAlias = Callable[..., Station]
"""`Station` without its second argument, the profile."""


@pytest.fixture(scope="session")
def simulated_profile() -> DeviceProfile:
    """What is simulated: a TMCM-3216. Override it to simulate another model."""
    return Catalog.load().profile(MODEL)


@pytest.fixture
def simulated_nodes() -> tuple[int, ...]:
    """The node IDs on `simulated_port`: just 1. Override or parametrize it to have others."""
    return (1,)


@pytest.fixture
def simulated_module(simulated_profile: DeviceProfile) -> MakeStation:
    """Makes stations of simulated modules on a memory wire, for asyncio tests.

    ``async with simulated_module() as station:`` gives node 1, ``simulated_module((1, 2))`` two nodes; for
    more see `drivers.sim.station.Station`. Join the wire with ``station.wire.port("me")``. The modules live
    on the loop's clock: on a virtual clock a day of theirs takes no time.
    """
    return partial(Station, profile=simulated_profile)


@pytest.fixture
def simulated_port(
    simulated_profile: DeviceProfile, simulated_nodes: tuple[int, ...]
) -> Iterator[BackgroundStation]:
    """Simulated modules behind a socketcand server at `host` and `port`, in real time, in a thread.

    Any program can join: with python-can ``can.Bus(interface="socketcand", host=..., port=...,
    channel="can0")``. Act on the modules with ``simulated_port.panel(1).perform("press_switch", axis=0,
    switch="home")``, or with ``simulated_port.call(lambda station: ...)``.
    """
    with BackgroundStation(partial(_station, simulated_profile, simulated_nodes)) as background:
        yield background


def _station(profile: DeviceProfile, nodes: tuple[int, ...], listen: Listen) -> Station:
    return Station(nodes, profile, listen=listen)
