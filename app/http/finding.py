"""Nodes and axes by what a path calls them: who is unknown is unknown here, and nowhere else."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Path

from app.http.parts import Part
from drivers.master.axis.axis import Axis
from drivers.master.network import Network
from drivers.master.node.node import Node

LONGEST_REFERENCE = 64
"""Characters of what a path calls a node or an axis."""

NETWORK: Part[Network] = Part("network")
NetworkDep = Annotated[Network, Depends(NETWORK.get)]

NodeRef = Annotated[
    str,
    Path(
        description="Node ID, or the node's name.", max_length=LONGEST_REFERENCE, examples=["1"], min_length=1
    ),
]
AxisRef = Annotated[
    str,
    Path(
        description="Axis number, or the axis's name.",
        max_length=LONGEST_REFERENCE,
        examples=["0"],
        min_length=1,
    ),
]


def find_node(network: Network, node: int | str) -> Node:
    """The node of that ID or name; digits are its ID, also as text. Raises `UnknownNode`."""
    return network.node(_reference(node))


def find_axis(network: Network, node: int | str, axis: int | str) -> Axis:
    """The axis of that number or name, of that node. Raises `UnknownNode`, `UnknownAxis`."""
    return find_node(network, node).axis(_reference(axis))


def every_axis_of(network: Network) -> list[Axis]:
    """All axes of all nodes."""
    return [axis for node in network.nodes.values() for axis in node.axes]


def _reference(given: int | str) -> int | str:
    return int(given) if isinstance(given, str) and given.isascii() and given.isdecimal() else given
