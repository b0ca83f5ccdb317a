"""How a model shows an example of itself in the API's document, and what many examples have in them."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict

Example = dict[str, Any]


def shown(example: Example) -> ConfigDict:
    """The part of a model's configuration that shows an example of it."""
    return ConfigDict(json_schema_extra={"examples": [example]})


TIME = "2026-01-01T12:00:00Z"
OBSTACLE: Example = {
    "code": "not_enabled",
    "message": "The axis is switch_on_disabled.",
    "remedy": "Enable the axis.",
    "action": {"method": "POST", "path": "/api/v1/nodes/1/axes/0/enable", "body": {}},
}
