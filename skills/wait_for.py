"""Wait until objects come into the wrist camera's view."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import Duration, Failure, SightPorts, Skill, own_camera, port, still_picture


class WaitFor(Skill):
    """Wait, without moving, until enough objects of one kind are in the wrist camera's view."""

    class Ports(SightPorts):
        least: int = port(1, "number of objects that must be in view", ge=1, le=100)
        confirm: int = port(3, "number of successive images that must show them", ge=1, le=100)
        every: Duration = port(0.1, "time between two images", le=60)
        wait: Duration = port(60.0, "longest wait", gt=0)

    failures = {
        "NO_CAMERA": "the arm has no camera that moves with it",
        "INVALID_TARGET": "the object has no color that can be detected, or no size is given",
        "NOT_SEEN": "too few objects came into view in time",
    }
    example = "wait_for: {object: cube, wait: 5.0}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Evaluate one image after the other, each on its own."""
        ports = self.ports
        began = self.time
        confirmed = 0
        most = 0
        own_camera(self.arm)
        while confirmed < ports.confirm:
            looked = self.time
            picture = yield from still_picture(self.arm, 1)
            seen = ports.sighted(self.arm, self.context.cell.zones)
            if picture is not None:
                seen.take(picture)
            most = max(most, len(seen.objects))
            confirmed = confirmed + 1 if len(seen.objects) >= ports.least else 0
            if confirmed < ports.confirm and self.time - began > ports.wait:
                raise Failure(
                    "NOT_SEEN",
                    f"{most} of {ports.least} objects came into view within {ports.wait:.1f} s; "
                    f"in the last image {seen.others}",
                    found=most,
                    beyond_share=seen.beyond,
                    waited_s=self.time - began,
                )
            while confirmed < ports.confirm and self.time - looked < ports.every:
                yield None
        self.metrics["waited_s"] = self.time - began
