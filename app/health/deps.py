"""How the service is doing, for the routes that tell it."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.health.condition import Condition
from app.health.metrics import METRICS, Metrics
from app.http.parts import Part

CONDITION: Part[Condition] = Part("condition")
ConditionDep = Annotated[Condition, Depends(CONDITION.get)]
MetricsDep = Annotated[Metrics, Depends(METRICS.get)]
