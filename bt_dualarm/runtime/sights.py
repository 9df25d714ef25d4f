"""What cameras' pictures show: noted for a record, or known from one and not looked for again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from bt_dualarm.runtime.notes import Notes
from bt_dualarm.runtime.picture_file import PictureFile
from bt_dualarm.world.cameras.frame import Frame, Plain
from bt_dualarm.world.rendering.renderer import Region


@dataclass(frozen=True)
class KnownPicture:
    """A picture that was taken before.

    Attributes:
        region: Part of the image that was exposed.
        stride: Edge of the blocks of pixels that share one sample.
        crc: Checksum of its pixels.
        answers: What was found in it, by question.
    """

    region: Region
    stride: int
    crc: int
    answers: Mapping[str, Plain]


@dataclass
class Sights:
    """What one camera's pictures show; a `Memory` of its frames.

    Attributes:
        arm: Name of the camera's arm.
        notes: Notes that are made of it, None where nobody reads them.
        pictures: File that keeps the pictures themselves, None where there is none.
        known: Pictures that were taken before, by their stamp; they are not drawn again until
            somebody asks them something new.
        taken: Number of pictures that were not drawn, as they were known.
        drawn: Number of those that were drawn all the same.
    """

    arm: str
    notes: Notes | None = None
    pictures: PictureFile | None = None
    known: Mapping[float, KnownPicture] = field(default_factory=dict)
    taken: int = 0
    drawn: int = 0

    @property
    def keeps(self) -> bool:
        """Whether anything is noted or known."""
        return self.notes is not None or bool(self.known)

    def knows(self, stamp: float, region: Region, stride: int) -> bool:
        """Whether such a picture is known, and what those who looked at it found."""
        picture = self.known.get(stamp)
        if picture is None or (picture.region, picture.stride) != (region, stride):
            return False
        self.taken += 1
        return True

    def recall(self, stamp: float, question: str, look: Callable[[], Plain]) -> Plain:
        """The answer to a question about the picture of a stamp; noted, if anybody notes."""
        picture = self.known.get(stamp)
        if picture is not None and question in picture.answers:
            answer = picture.answers[question]
        else:
            self.drawn += picture is not None
            answer = look()
        if self.notes is not None:
            self.notes.of_answer(self.arm, stamp, question, answer)
        return answer

    def note(self, frame: Frame) -> None:
        """Note a picture that was taken."""
        if self.notes is not None:
            picture = self.known.get(frame.stamp)
            self.notes.of_frame(self.arm, frame, None if picture is None else picture.crc)
            if self.pictures is not None:
                self.pictures.add(self.arm, self.notes.clock(), frame)
