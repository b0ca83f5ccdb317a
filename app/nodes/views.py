"""Nodes as the wire shows them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from app.axes.views import axis_path, change
from app.nodes.schemas import AxisName, BootReply, BootStepReply, EmergencyReply, IdentityReply, NodeReply
from drivers.master.node.node import Node
from drivers.master.seen.boot_log import BootStep, StepState
from drivers.master.seen.emergencies import EmergencyRecord


def node(node: Node) -> NodeReply:
    """A node as it is now."""
    status = node.status()
    identity = status.identity
    return NodeReply(
        node=node.node_id,
        name=node.name,
        model=node.config.model,
        state=status.state.value,
        reason=status.reason,
        nmt_state=None if status.nmt_state is None else status.nmt_state.name.lower(),
        identity=None
        if identity is None
        else IdentityReply(
            device_type=f"0x{identity.device_type:08X}",
            vendor_id=f"0x{identity.vendor_id:08X}",
            product_code=f"0x{identity.product_code:08X}",
            revision=identity.revision,
            serial=identity.serial,
        ),
        device_name=status.device_name,
        hardware_version=status.hardware_version,
        software_version=status.software_version,
        serial=status.serial,
        failsafe=status.failsafe.value,
        heartbeat_age_s=None if status.heartbeat_age_s is None else round(status.heartbeat_age_s, 4),
        boot=_boot(status.boot),
        axes=[
            AxisName(axis=axis.number, name=axis.name, unit=axis.config.unit, path=axis_path(axis))
            for axis in node.axes
        ],
        counters=dataclasses.asdict(status.counters),
    )


def _boot(steps: Sequence[BootStep]) -> BootReply:
    return BootReply(
        complete=all(step.state in (StepState.DONE, StepState.SKIPPED) for step in steps),
        took_s=round(sum(step.took_s or 0.0 for step in steps), 4),
        steps=[_boot_step(step) for step in steps],
    )


def _boot_step(step: BootStep) -> BootStepReply:
    return BootStepReply(
        name=step.name.value,
        state=step.state.value,
        compared=step.compared,
        written=step.written,
        changes=[change(one) for one in step.changes],
        note=step.note,
        reason=step.reason,
        remedy=step.remedy,
        took_s=None if step.took_s is None else round(step.took_s, 4),
    )


def emergency(record: EmergencyRecord) -> EmergencyReply:
    """One emergency."""
    return EmergencyReply(
        id=record.id,
        time=record.time,
        node=record.node,
        axis=record.axis,
        code=f"0x{record.code:04X}",
        register_=f"0x{record.register:02X}",
        data=record.data.hex(" "),
        title=record.title,
        cause=record.cause,
        remedy=record.remedy,
        severity=record.severity.value,
        active=record.active,
    )
