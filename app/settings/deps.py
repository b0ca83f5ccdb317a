"""The book of settings, for its routes."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends

from app.http.parts import Part
from app.settings.book import SettingsBook

BOOK: Part[SettingsBook] = Part("settings")
BookDep = Annotated[SettingsBook, Depends(BOOK.get)]
