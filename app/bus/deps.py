"""The bus, for the routes that show it."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.bus.opening import BusOpener
from app.http.parts import Part

BUS: Part[BusOpener] = Part("bus")
BusDep = Annotated[BusOpener, Depends(BUS.get)]
