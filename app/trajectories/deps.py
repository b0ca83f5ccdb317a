"""What trajectories are configured with, for their route."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.configuration.configuration import TrajectoryConfiguration
from app.http.parts import Part

TRAJECTORIES: Part[TrajectoryConfiguration] = Part("trajectories")
TrajectoriesDep = Annotated[TrajectoryConfiguration, Depends(TRAJECTORIES.get)]
