"""The leases, for those that heed them."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.http.parts import Part
from app.leases.leases import Leases

LEASES: Part[Leases] = Part("leases")
LeasesDep = Annotated[Leases, Depends(LEASES.get)]
