"""The open connections that jog, for the route that opens one."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.http.parts import Part
from app.jog.jogs import Jogs

JOGS: Part[Jogs] = Part("jogs")
JogsDep = Annotated[Jogs, Depends(JOGS.get)]
