"""Whether objects may be written, for the route that writes them."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.configuration.configuration import ObjectsConfiguration
from app.http.parts import Part

OBJECTS: Part[ObjectsConfiguration] = Part("objects")
ObjectsDep = Annotated[ObjectsConfiguration, Depends(OBJECTS.get)]
