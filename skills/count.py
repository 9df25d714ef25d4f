"""Count what is in the wrist camera's view."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import Failure, PortModel, SightPorts, Skill, port, still_picture


class Count(Skill):
    """Count the things of a kind that are whole in the arm's own camera's view; it may be none."""

    class Ports(SightPorts):
        frames: int = port(4, "pictures that are merged", ge=1, le=100)

    class Outputs(PortModel):
        count: int = port(..., "How many there are")

    failures = {
        "NO_CAMERA": "the arm has no camera of its own",
        "INVALID_TARGET": "the object has no colour that can be found, or no size is given",
        "NOT_SEEN": "the camera gave no picture in time",
    }
    example = "count: {object: cube}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Take one look from where the arm stands."""
        seen = self.ports.sighted(self.arm)
        picture = yield from still_picture(self.arm, self.ports.frames)
        if picture is None:
            raise Failure("NOT_SEEN", "the camera gave no picture in time")
        seen.take(picture)
        self.output("count", len(seen.things))
        self.metrics |= {"found": len(seen.things), "unlike": seen.unlike}
        self.metrics["beyond_share"] = seen.beyond
