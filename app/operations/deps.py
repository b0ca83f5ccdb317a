"""The register of operations, for the routes."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.http.parts import Part
from app.operations.register import OperationRegister

OPERATIONS: Part[OperationRegister] = Part("operations")
OperationsDep = Annotated[OperationRegister, Depends(OPERATIONS.get)]
