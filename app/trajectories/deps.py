"""What trajectories are configured with, for their route."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.configuration.configuration import TrajectorySettings
from app.http.parts import Part

TRAJECTORIES: Part[TrajectorySettings] = Part("trajectories")
TrajectoriesDep = Annotated[TrajectorySettings, Depends(TRAJECTORIES.get)]
