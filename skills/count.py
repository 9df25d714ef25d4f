"""Count the objects in the wrist camera's view."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import Failure, PortModel, SightPorts, Skill, port, standing_of, still_picture


class Count(Skill):
    """Count the objects of one kind that are fully in the wrist camera's view."""

    class Ports(SightPorts):
        frames: int = port(4, "images that are averaged", ge=1, le=100)
        height: float | None = port(
            None,
            "height of their support in the world; by default from the declared objects",
            unit="m",
            ge=-100,
            le=100,
        )
        others: bool = port(
            False,
            "whether objects of another shape or size may be in view, which are not counted; they "
            "must neither touch nor occlude counted ones",
        )
        stacked: bool = port(
            True,
            "whether they may be stacked; then an object that may be on another one is ambiguous",
        )

    class Outputs(PortModel):
        count: int = port(..., "Number of objects")

    failures = {
        "NO_CAMERA": "the arm has no camera that moves with it",
        "INVALID_TARGET": "the object has no color that can be detected, or no size is given",
        "NOT_SEEN": "the camera gave no image in time",
        "AMBIGUOUS": "a region of the color may be several objects, a part of one, or none",
    }
    example = "count: {object: cube}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Evaluate one averaged image from the current pose."""
        ports = self.ports
        seen = ports.sighted(self.arm, self.context.cell.zones)
        try:
            yield from self.arm.come_to_rest()  # the motion of a halted leaf may still be braking
        except Failure as failure:
            if failure.code != "BUSY":  # a leaf beside this one may move the arm, or hold it still
                raise
        picture = yield from still_picture(self.arm, ports.frames)
        if picture is None:
            raise Failure("NOT_SEEN", "the camera gave no image in time")
        seen.take(picture)
        standing = [
            standing_of(self.arm.world, seen, obj, ports.height)
            if ports.flat and not ports.is_by_marker
            else None
            for obj in seen.objects
        ]
        ratios = [None if one is None else one.other_size for one in standing]
        other = [ratio for ratio in ratios if ratio is not None]
        maybe = 0
        if ports.stacked and not ports.others:
            pairs = zip(standing, ratios, strict=True)
            maybe = sum(r is None and one is not None and one.may_hide_another for one, r in pairs)
        found = len(ratios) - len(other) - maybe
        self.metrics |= {"found": found, "unlike": seen.unlike, "beyond_share": seen.beyond}
        self.metrics |= {"other_size": len(other), "maybe_stacked": maybe}
        if not ports.others and not ports.is_by_marker:
            doubts = []
            if seen.unlike > seen.others_whole:
                doubts.append(
                    f"{seen.unlike - seen.others_whole} of another outline (touching or partly "
                    "occluded objects, or something else)"
                )
            if other:
                times = ", ".join(f"{ratio:.2f}" for ratio in other)
                doubts.append(
                    f"{len(other)} of another size ({times} times the declared one), or not "
                    "on the declared support"
                )
            if maybe:
                doubts.append(
                    f"{maybe} may be on another one: stacked low objects look like a single nearer "
                    "one (`stacked: false` if none are stacked)"
                )
            if seen.is_ground:
                doubts.append(
                    f"the background has the color, too: {100 * seen.beyond:.0f} % of the image, "
                    "up to its edge"
                )
            if doubts:
                raise Failure(
                    "AMBIGUOUS",
                    f"{found} certain; in doubt: {'; '.join(doubts)}. Use another viewpoint, "
                    "move them apart, give the `height` of their support, or set `others: true` if "
                    "the doubtful ones should not be counted",
                )
        self.output("count", found)
