"""Where moves were meant to end, for the routes that begin some."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.http.parts import Part
from app.moves.meant import Meant

MEANT: Part[Meant] = Part("meant")
MeantDep = Annotated[Meant, Depends(MEANT.get)]
