"""What every part of the configuration is made of."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,62}$")]


class ConfigurationError(Exception):
    """The settings can't be used; the text says which key and why, one line for each."""


class Section(BaseModel):
    """A part of the tree; refuses keys that it doesn't know."""

    model_config = ConfigDict(extra="forbid", frozen=True)
