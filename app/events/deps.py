"""The open streams, for the route that opens one."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.events.streams import Streams
from app.http.parts import Part

STREAMS: Part[Streams] = Part("streams")
StreamsDep = Annotated[Streams, Depends(STREAMS.get)]
