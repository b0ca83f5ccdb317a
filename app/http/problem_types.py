"""The description behind a problem's `type`."""

from __future__ import annotations

from app.http import examples
from app.http.problems import PROBLEM_TYPES, ApiError
from app.http.schemas import Reply

_PROBLEM_TYPE: examples.Example = {
    "type": "/problems/not-ready",
    "code": "not_ready",
    "status": 409,
    "title": "Axis not ready",
    "explanation": "The list `obstacles` names what prevents the command, and its remedy.",
}


class ProblemTypeReply(Reply):
    """The description of one kind of problem."""

    model_config = examples.shown(_PROBLEM_TYPE)

    type: str
    code: str
    status: int
    title: str
    explanation: str


def problem_type(name: str) -> ProblemTypeReply:
    """The description at ``/problems/{name}``. Raises `ApiError` (404)."""
    row = PROBLEM_TYPES.get(name.replace("-", "_"))
    if row is None:
        raise ApiError("unknown_problem", "There is no such kind of problem.")
    return ProblemTypeReply(
        type=row.uri, code=row.code, status=row.status, title=row.title, explanation=row.explanation
    )
