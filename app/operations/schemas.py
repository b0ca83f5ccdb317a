"""Operations: commands that take time."""

from __future__ import annotations

import enum
from datetime import datetime
from typing import Any

from pydantic import Field

from app.access.schemas import Asker
from app.axes.schemas import Quantity
from app.http import examples
from app.http.schemas import Problem, Reply


class OperationState(enum.StrEnum):
    """Where an operation is in its life."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


class OperationLinks(Reply):
    """Where to go from here."""

    self: str
    cancel: str
    axis: str | None = Field(description="None where it is about several axes, or a node as such.")


class OperationAxis(Reply):
    """An axis that takes part."""

    node: int
    axis: int
    name: str


class AxisTrack(Reply):
    """Where an axis was, was sent and is; None where it is not known."""

    node: int
    axis: int
    start: Quantity | None
    target: Quantity | None
    end: Quantity | None = Field(description="When the operation ended.")


class SightReply(Reply):
    """A statusword that differed from the one before."""

    node: int
    axis: int
    after_s: float = Field(description="Seconds since the operation was begun.")
    statusword: str = Field(description="6041h, hexadecimal.")
    position: Quantity | None


class SeenEmergency(Reply):
    """An emergency that came meanwhile."""

    node: int
    axis: int | None
    time: datetime
    code: str = Field(description="Hexadecimal.")
    title: str


class FoundAxis(Reply):
    """An axis as it was found after the service had started again."""

    node: int
    axis: int
    time: datetime
    state: str | None = Field(description="CiA 402 state.")
    moving: bool
    position: Quantity | None
    velocity: Quantity | None


class EvidenceReply(Reply):
    """What was seen of the axes: enough to tell afterwards what really happened."""

    axes: list[AxisTrack]
    statuswords: list[SightReply] = Field(
        description="The changes, oldest first: the first 32 and the last 32."
    )
    left_out: int = Field(description="Changes of the statusword in between that are not kept.")
    emergencies: list[SeenEmergency] = Field(description="The first 16.")
    found: list[FoundAxis] = Field(
        default=[], description="After a restart of the service: the axes as they were found."
    )


OPERATION: examples.Example = {
    "id": "6f1c2a7b9d3e4f506f1c2a7b9d3e4f50",
    "kind": "move",
    "node": 1,
    "axis": 0,
    "axes": [{"node": 1, "axis": 0, "name": "x"}],
    "state": "running",
    "progress": 0.4,
    "request": {
        "target": 51200,
        "unit": "steps",
        "relative": False,
        "target_steps": 51200,
        "target_commanded": 51200,
        "rounded_by": 0,
    },
    "result": None,
    "error": None,
    "reason": None,
    "asked_by": {"name": "anonymous", "address": "127.0.0.1"},
    "evidence": {
        "axes": [
            {
                "node": 1,
                "axis": 0,
                "start": {"steps": 0, "value": 0.0, "unit": "steps"},
                "target": {"steps": 51200, "value": 51200.0, "unit": "steps"},
                "end": None,
            }
        ],
        "statuswords": [
            {
                "node": 1,
                "axis": 0,
                "after_s": 0.012,
                "statusword": "0x5237",
                "position": {"steps": 12, "value": 12.0, "unit": "steps"},
            }
        ],
        "left_out": 0,
        "emergencies": [],
        "found": [],
    },
    "created": examples.TIME,
    "started": examples.TIME,
    "ended": None,
    "links": {
        "self": "/api/v1/operations/6f1c2a7b9d3e4f506f1c2a7b9d3e4f50",
        "cancel": "/api/v1/operations/6f1c2a7b9d3e4f506f1c2a7b9d3e4f50/cancel",
        "axis": "/api/v1/nodes/1/axes/0",
    },
}


class OperationReply(Reply):
    """A moving command: what was asked, how far it is, how it ended."""

    model_config = examples.shown(OPERATION)

    id: str
    kind: str = Field(description="move, velocity, home, set_position or wait_input.")
    node: int | None = Field(description="None where it is about several axes: see `axes`.")
    axis: int | None = Field(description="None where it is about several axes: see `axes`.")
    axes: list[OperationAxis] = Field(description="Every axis that takes part.")
    state: OperationState
    progress: float | None = Field(description="0 to 1, where it can be told.")
    predicted_s: float | None = Field(
        default=None,
        description="How long it should take, without what it waits for; of a homing the longest. None while "
        "that isn't known.",
    )
    predicted_peak_velocity: Quantity | None = Field(
        default=None, description="The highest speed on the way."
    )
    request: dict[str, Any] = Field(
        description="What was asked; for a target or a velocity also the steps that are commanded, the same "
        "in the unit that was asked in, and `rounded_by`: what is commanded less what was asked."
    )
    result: dict[str, Any] | None = Field(description="What came of it, once it succeeded.")
    error: Problem | None = Field(description="Why it failed.")
    reason: str | None = Field(description="Why it failed or was cancelled, as a sentence.")
    asked_by: Asker
    evidence: EvidenceReply
    created: datetime
    started: datetime | None
    ended: datetime | None
    links: OperationLinks


class OperationList(Reply):
    """Operations, the newest first."""

    model_config = examples.shown({"operations": [OPERATION]})

    operations: list[OperationReply]
