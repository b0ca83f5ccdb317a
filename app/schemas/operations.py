"""Operations: commands that take time."""

from __future__ import annotations

import enum
from datetime import datetime
from typing import Any

from pydantic import Field

from app.schemas import examples
from app.schemas.common import Problem, Reply


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
    axis: str


class OperationReply(Reply):
    """A moving command: what was asked, how far it is, how it ended."""

    model_config = examples.shown(examples.OPERATION)

    id: str
    kind: str = Field(description="move, velocity or home.")
    node: int
    axis: int
    state: OperationState
    progress: float | None = Field(description="0 to 1, where it can be told.")
    request: dict[str, Any] = Field(description="What was asked, with the steps that it came to.")
    result: dict[str, Any] | None = Field(description="What came of it, once it succeeded.")
    error: Problem | None = Field(description="Why it failed.")
    reason: str | None = Field(description="Why it failed or was cancelled, as a sentence.")
    created: datetime
    started: datetime | None
    ended: datetime | None
    links: OperationLinks


class OperationList(Reply):
    """Operations, the newest first."""

    model_config = examples.shown({"operations": [examples.OPERATION]})

    operations: list[OperationReply]
