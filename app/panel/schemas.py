"""Replies of the panel; they hold the snapshots of `drivers.sim.snapshot` as they are."""

from __future__ import annotations

from pydantic import RootModel

from app.http.schemas import Reply
from drivers.sim.snapshot import ModuleSnapshot


class ModuleReply(RootModel[ModuleSnapshot]):
    """One simulated module."""


class ModuleList(Reply):
    """Every simulated module."""

    nodes: list[ModuleReply]
