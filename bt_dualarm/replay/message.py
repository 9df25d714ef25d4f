"""One message of a record, with its time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Message:
    """One message.

    Attributes:
        topic: Name of its channel.
        schema: Name of what it says, as in `message_schemas`.
        time_s: Simulated time in s.
        content: Fields, ready for JSON.
    """

    topic: str
    schema: str
    time_s: float
    content: Mapping[str, object]

    @property
    def nanoseconds(self) -> int:
        """Simulated time in ns."""
        return round(1e9 * self.time_s)


def timestamp(time: float) -> dict[str, int]:
    """A time in s as whole seconds and nanoseconds."""
    seconds, nanoseconds = divmod(round(1e9 * time), 10**9)
    return {"sec": seconds, "nsec": nanoseconds}
