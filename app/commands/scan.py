"""`canaxis scan`: which nodes are on a bus, and what they are."""

from __future__ import annotations

import asyncio
from typing import Annotated

import typer

from app.commands.serve import parse_option
from app.configuration.configuration import BusConfiguration
from drivers.bus.pythoncan import PythonCanBus
from drivers.devices.catalog import Catalog
from drivers.master.scan import scan as scan_bus


def scan(
    interface: Annotated[str, typer.Option(help="python-can's interface, e.g. socketcan.")] = "socketcand",
    channel: Annotated[str, typer.Option(help="python-can's channel, e.g. can0.")] = "can0",
    bitrate: Annotated[int | None, typer.Option(help="bit/s, e.g. 1000000.")] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="Another option of the interface, NAME=VALUE; may be repeated.")
    ] = None,
) -> None:
    """List the nodes that answer.

    Not while a service runs on the bus: each would take the other's answers.
    """
    bus = BusConfiguration(
        interface=interface,
        channel=channel,
        bitrate=bitrate,
        options=dict(map(parse_option, option or ())),
    )
    found = asyncio.run(scan_bus(PythonCanBus(**bus.arguments())))
    if not found:
        print("No node answers. Check the cable, the termination, the supply and the bit rate.")
        return
    catalog = Catalog.load()
    print(f"{'node':>4}  {'name':<20} {'vendor':>8} {'product':>8} {'serial':>10}  known as")
    for node in found:
        vendor, product = node.vendor_id or 0, node.product_code or 0
        profile = catalog.identify(vendor, product)
        known = "-" if profile is None else profile.model
        serial = "-" if node.serial is None else str(node.serial)
        print(f"{node.node_id:>4}  {node.name or '-':<20} {vendor:>8X} {product:>8X} {serial:>10}  {known}")
