"""Count what is in the wrist camera's view."""

from __future__ import annotations

from collections.abc import Iterator

from bt_dualarm import (
    Failure,
    PortModel,
    SightPorts,
    Skill,
    other_size_standing,
    port,
    still_picture,
)


class Count(Skill):
    """Count the things of a kind that are whole in the arm's own camera's view; it may be none."""

    class Ports(SightPorts):
        frames: int = port(4, "pictures that are merged", ge=1, le=100)
        height: float | None = port(
            None,
            "height in the world of what they stand on; by default that of what is declared there",
            unit="m",
            ge=-100,
            le=100,
        )
        others: bool = port(
            False,
            "whether things of another shape or size may be in view, none of which touches or "
            "covers one that is to be counted: they are left out",
        )

    class Outputs(PortModel):
        count: int = port(..., "How many there are")

    failures = {
        "NO_CAMERA": "the arm has no camera of its own",
        "INVALID_TARGET": "the object has no colour that can be found, or no size is given",
        "NOT_SEEN": "the camera gave no picture in time",
        "AMBIGUOUS": "something of the colour may be several of them, a part of one, or none",
    }
    example = "count: {object: cube}"
    needs_camera = True
    ports: Ports

    def run(self) -> Iterator[float | None]:
        """Take one look from where the arm stands."""
        ports = self.ports
        seen = ports.sighted(self.arm)
        picture = yield from still_picture(self.arm, ports.frames)
        if picture is None:
            raise Failure("NOT_SEEN", "the camera gave no picture in time")
        seen.take(picture)
        ratios = [
            other_size_standing(self.arm.world, seen, thing, ports.height)
            if ports.flat and not ports.is_by_marker
            else None
            for thing in seen.things
        ]
        other = [ratio for ratio in ratios if ratio is not None]
        found = len(ratios) - len(other)
        self.metrics |= {"found": found, "unlike": seen.unlike, "beyond_share": seen.beyond}
        self.metrics["other_size"] = len(other)
        if not ports.others and not ports.is_by_marker:
            doubts = []
            if seen.unlike > seen.others_whole:
                doubts.append(
                    f"{seen.unlike - seen.others_whole} of another outline (several that touch, "
                    "one that is covered in part, or something else)"
                )
            if other:
                times = ", ".join(f"{ratio:.2f}" for ratio in other)
                doubts.append(
                    f"{len(other)} of another size ({times} times the declared one), or not "
                    "standing on what is declared below"
                )
            if seen.is_ground:
                doubts.append(
                    f"what covers {100 * seen.beyond:.0f} % of the picture up to its edge has the "
                    "colour, too"
                )
            if doubts:
                raise Failure(
                    "AMBIGUOUS",
                    f"{found} for certain, and in doubt: {'; '.join(doubts)}. Look from elsewhere, "
                    "move them apart, give the `height` of what they stand on, or say `others: "
                    "true` if what is in doubt is none of them",
                )
        self.output("count", found)
