"""What goes wrong between a client and a run. Every error of this package is a `HapticdError`."""

from __future__ import annotations

from typing import Any


class HapticdError(Exception):
    """Anything that this package raises of its own."""


class Refused(HapticdError):
    """The server did not do what it was asked for. The message is the server's own, with its hint."""

    status: int
    """Number of the refusal, as in HTTP: `docs/reference/api.md`, section 3."""
    error: str
    """What is wrong, in the server's words."""
    hint: str
    """What would help; empty where the server knows none."""

    def __init__(self, status: int, error: str, hint: str = "") -> None:
        super().__init__(f"{error} ({hint})" if hint else error)
        self.status, self.error, self.hint = status, error, hint


class Invalid(Refused, ValueError):
    """The request makes no sense (400): a value out of its range, a key that is missing, unknown or of another type."""


class Forbidden(Refused):
    """The token is missing or wrong, or this client may not come in (401, 403)."""


class Unknown(Refused, LookupError):
    """No such parameter, object, scene or mesh (404); everything about clay where there is none."""


class Conflict(Refused):
    """Not as things stand (409): being baked, no heartbeat, already recording, no stroke to take back."""


class Unavailable(Refused):
    """Not yet, not in this run, no place left, or too many requests (429, 503)."""


class Disconnected(HapticdError, ConnectionError):
    """There is no connection: none could be made, or it has ended."""


class NoAnswer(HapticdError, TimeoutError):
    """The server, or what was waited for, did not come in time."""


_BY_STATUS: dict[int, type[Refused]] = {
    400: Invalid,
    401: Forbidden,
    403: Forbidden,
    404: Unknown,
    409: Conflict,
    429: Unavailable,
    503: Unavailable,
}


def refusal(status: int, said: Any) -> Refused:
    """The error for a refusal, from `{"error", "hint"}` of a reply or a body."""
    error, hint = (said.get("error"), said.get("hint")) if isinstance(said, dict) else (None, None)
    return _BY_STATUS.get(status, Refused)(status, error or f"the server answered {status}", hint or "")
