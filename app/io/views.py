"""Inputs and outputs as the wire shows them."""

from __future__ import annotations

from collections.abc import Sequence

from app.io.schemas import AnalogInputReply, DigitalInputReply, InputsReply, OutputReply, SwitchReply
from drivers.master.node.conditions import switches_of
from drivers.master.node.io import AnalogLevel, DigitalLevel, Output
from drivers.master.node.node import Node


def inputs(
    node: Node, digital: Sequence[DigitalLevel], analog: Sequence[AnalogLevel], age_s: float
) -> InputsReply:
    """The inputs of a node; `age_s`: since the levels were asked for."""
    switches: list[SwitchReply] = []
    for axis, switch, name in switches_of(node):
        age = axis.age()
        switches.append(
            SwitchReply(
                axis=axis.number,
                name=name,
                on=bool(getattr(axis.status.switches, switch)),
                age_s=None if age is None else round(age, 4),
                stale=axis.status.stale,
            )
        )
    return InputsReply(
        node=node.node_id,
        digital=[DigitalInputReply(number=d.number, name=d.name, on=d.on) for d in digital],
        analog=[
            AnalogInputReply(
                number=a.number,
                name=a.name,
                raw=a.raw,
                volts=None if a.volts is None else round(a.volts, 6),
            )
            for a in analog
        ],
        switches=switches,
        age_s=round(age_s, 4),
    )


def output(node: Node, level: Output) -> OutputReply:
    """One output."""
    return OutputReply(
        node=node.node_id,
        number=level.number,
        name=level.name,
        on=level.on,
        usable=level.usable,
        push_pull=level.push_pull,
    )
