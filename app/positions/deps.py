"""The named positions, for the routes that use them."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.http.parts import Part
from app.positions.positions import Positions

POSITIONS: Part[Positions] = Part("positions")
PositionsDep = Annotated[Positions, Depends(POSITIONS.get)]
