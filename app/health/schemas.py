"""The service itself on the wire."""

from __future__ import annotations

from pydantic import Field

from app.http import examples
from app.http.schemas import Reply


class LiveReply(Reply):
    """The process answers."""

    model_config = examples.shown({"status": "alive"})

    status: str = Field(examples=["alive"])


class ReadyReply(Reply):
    """Whether everything that is configured can be commanded, and what is missing."""

    model_config = examples.shown({"ready": False, "reasons": ["Node 1 (stage) is absent."], "warnings": []})

    ready: bool
    reasons: list[str]
    warnings: list[str] = Field(description="What does not prevent commands, but should be put right.")


_SERVICE: examples.Example = {"name": "canaxis", "version": "0.1.0", "links": {"nodes": "/api/v1/nodes"}}


class ServiceReply(Reply):
    """Where everything is."""

    model_config = examples.shown(_SERVICE)

    name: str
    version: str
    links: dict[str, str]
