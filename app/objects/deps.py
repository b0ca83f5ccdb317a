"""Whether objects may be written, for the route that writes them."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.configuration.configuration import ObjectsSettings
from app.http.parts import Part

OBJECTS: Part[ObjectsSettings] = Part("objects")
ObjectsDep = Annotated[ObjectsSettings, Depends(OBJECTS.get)]
