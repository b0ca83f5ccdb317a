"""Trajectories: the body as the document shows it, since it is read piece by piece, and the forecast."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from app.axes.schemas import Quantity
from app.http.schemas import Reply

_NUMBERS: dict[str, Any] = {"type": "array", "items": {"type": "number"}, "minItems": 1, "maxItems": 24}
BODY: dict[str, Any] = {
    "required": True,
    "content": {
        "application/json": {
            "schema": {
                "title": "TrajectoryBody",
                "type": "object",
                "additionalProperties": False,
                "required": ["axes", "points"],
                "examples": [
                    {
                        "axes": [
                            {"node": "stage", "axis": "x", "unit": "steps"},
                            {"node": "stage", "axis": "y", "unit": "steps"},
                        ],
                        "cycle_ms": 10,
                        "points": [
                            {"t": 0.0, "positions": [0, 0], "velocities": [0, 0]},
                            {"t": 1.0, "positions": [10000, 5000], "velocities": [0, 0]},
                        ],
                    }
                ],
                "properties": {
                    "axes": {
                        "type": "array",
                        "minItems": 1,
                        "maxItems": 24,
                        "description": "In the order of the numbers of each point.",
                        "items": {
                            "type": "object",
                            "additionalProperties": False,
                            "required": ["node", "axis", "unit"],
                            "properties": {
                                "node": {"type": ["string", "integer"], "description": "ID or name."},
                                "axis": {"type": ["string", "integer"], "description": "Number or name."},
                                "unit": {"type": "string", "description": "Of the axis's numbers."},
                            },
                        },
                    },
                    "cycle_ms": {
                        "type": "integer",
                        "minimum": 1,
                        "maximum": 100,
                        "default": 10,
                        "description": "Milliseconds from set point to set point.",
                    },
                    "points": {
                        "type": "array",
                        "minItems": 2,
                        "items": {
                            "type": "object",
                            "additionalProperties": False,
                            "required": ["t", "positions"],
                            "properties": {
                                "t": {"type": "number", "description": "Seconds; rising."},
                                "positions": {**_NUMBERS, "description": "Of each axis, in its unit."},
                                "velocities": {**_NUMBERS, "description": "Of each axis, in its unit/s."},
                            },
                        },
                    },
                },
            },
        },
        "text/csv": {
            "schema": {
                "type": "string",
                "format": "binary",
                "description": "The first line names the columns: `t`, each axis as `node.axis[unit]`, and, "
                "if velocities are given, each axis again as `node.axis.v[unit/s]`.",
                "examples": ["t,stage.x[steps],stage.x.v[steps/s]\n0,0,0\n1,10000,0\n"],
            },
        },
    },
}
"""The request body. Both forms are read as they come, so there is no model of the whole."""


class AxisForecast(Reply):
    """One axis on the path."""

    node: int
    axis: int
    name: str
    end: Quantity
    lowest: Quantity
    highest: Quantity
    peak_velocity: Quantity = Field(description="Of the set points that will be sent, without direction.")
    peak_acceleration: Quantity


class TrajectoryForecast(Reply):
    """What a trajectory comes to, if it were begun now. Nothing was sent."""

    points: int
    cycles: int = Field(description="Set points of each axis.")
    cycle_ms: int
    duration_s: float
    axes: list[AxisForecast]
