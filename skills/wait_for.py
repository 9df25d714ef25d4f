"""Wait until something comes into the wrist camera's view."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import Duration, Failure, SightPorts, Skill, own_camera, port, still_picture


class WaitFor(Skill):
    """Wait, without moving, until so many things of a kind stand in the arm's own camera's view."""

    class Ports(SightPorts):
        least: int = port(1, "how many things have to be in view", ge=1, le=100)
        confirm: int = port(3, "pictures in a row that have to show them", ge=1, le=100)
        every: Duration = port(0.1, "time between two pictures", le=60)
        wait: Duration = port(60.0, "longest wait", gt=0)

    failures = {
        "NO_CAMERA": "the arm has no camera of its own",
        "INVALID_TARGET": "the object has no colour that can be found, or no size is given",
        "NOT_SEEN": "they did not come into view in time",
    }
    example = "wait_for: {object: cube, wait: 5.0}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Look again and again, each time as if for the first time."""
        ports, began, in_row, most = self.ports, self.time, 0, 0
        own_camera(self.arm)
        while in_row < ports.confirm:
            looked = self.time
            picture = yield from still_picture(self.arm, 1)
            seen = ports.sighted(self.arm)
            if picture is not None:
                seen.take(picture)
            most = max(most, len(seen.things))
            in_row = in_row + 1 if len(seen.things) >= ports.least else 0
            if in_row < ports.confirm and self.time - began > ports.wait:
                raise Failure(
                    "NOT_SEEN",
                    f"{most} of {ports.least} things came into view within {ports.wait:.1f} s; "
                    f"in the last picture {seen.others}",
                    found=most,
                    beyond_share=seen.beyond,
                    waited_s=self.time - began,
                )
            while in_row < ports.confirm and self.time - looked < ports.every:
                yield None
        self.metrics["waited_s"] = self.time - began
