"""How far the simulated arm, its sensors and drives are from what its controller believes.

A spread is drawn with the seed, once for each arm: a seed is one robot of the batch.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import BaseModel, Discriminator, Tag

from bt_dualarm.spec.name import written_as
from bt_dualarm.spec.ports import port
from bt_dualarm.spec.spread import Bend, Degrees, Metres, Seconds, Share, Spread
from bt_dualarm.spec.values import Duration, Value

RealityName: TypeAlias = Literal["ideal", "lab", "rough"]

REALITY_NAMES: Final[tuple[RealityName, ...]] = ("ideal", "lab", "rough")
"""Names of the sets, from the model itself to a neglected robot."""

_NONE: Final = Spread()


class LinkErrors(Value):
    """How far the links are from their page."""

    mass: Share = port(_NONE, "Share of a link's mass, its own for each link")
    inertia: Share = port(_NONE, "Share of a link's moments of inertia, besides that of its mass")
    center: Metres = port(_NONE, "Offset of a link's centre of mass along each axis", unit="m")
    rotor: bool = port(
        False,
        "Whether joints have the inertia of their motors' rotors behind the gear, which URDFs "
        "leave out; known as well as other inertia",
    )


class PayloadErrors(Value):
    """How far what is held is from the file; of the masses of objects the world's holds."""

    known: bool = port(True, "Whether the controller is told mass and centre of what is held")
    mass: Share = port(_NONE, "Share of an object's mass")
    center: Metres = port(_NONE, "Offset of an object's centre of mass along each axis", unit="m")


class FrictionErrors(Value):
    """Friction of the joints: that of the robot's page, and how well it is known."""

    present: bool = port(False, "Whether the joints rub")
    coulomb: Share = port(_NONE, "Share of the dry friction, its own for each joint")
    viscous: Share = port(_NONE, "Share of the friction that grows with speed, likewise")
    most: float = port(
        1.0, "Largest dry friction, as a share of the joint's effort limit", ge=0.0, le=1.0
    )


class EncoderErrors(Value):
    """What the joints' encoders do to a position, and how a velocity comes of it."""

    resolution: float = port(0.0, "Step of a reading; 0 for none", unit="deg", ge=0.0, le=1.0)
    noise: float = port(0.0, "Standard deviation of a reading's noise", unit="deg", ge=0.0, le=1.0)
    window: Duration = port(
        0.0,
        "Time over which two readings are differenced to a velocity; 0 for the exact velocity, "
        "which no encoder knows",
        le=0.1,
    )
    cutoff: float = port(
        0.0, "Corner of the velocity's low-pass filter; 0 for none", unit="Hz", ge=0.0, le=1e4
    )


class DriveErrors(Value):
    """What becomes of a torque between the controller and the joint."""

    delay: Duration = port(0.0, "Time until a torque that was commanded acts", le=0.05)
    bandwidth: float = port(
        0.0, "Corner of the drive's first-order lag; 0 for none", unit="Hz", ge=0.0, le=1e5
    )
    quantum: float = port(
        0.0, "Step of a torque, as a share of the effort limit; 0 for none", ge=0.0, le=0.1
    )
    gain: Share = port(_NONE, "Share by which a joint's torque is off, its own for each joint")


class CameraErrors(Value):
    """How far a camera is from its calibration, and what its pictures suffer."""

    position: Metres = port(_NONE, "Offset of the camera along each of its axes", unit="m")
    rotation: Degrees = port(_NONE, "Turn of the camera about each of its axes", unit="deg")
    focal: Share = port(_NONE, "Share of the focal length")
    stamp: Seconds = port(_NONE, "How late or early the clock of its stamps is", unit="s")
    noise: float = port(
        0.0, "Standard deviation of a pixel's noise, of 255 levels", ge=0.0, le=100.0
    )
    light: Share = port(_NONE, "Share of the brightness, another one for each picture")
    exposure: Duration = port(
        0.0,
        "Time for which the shutter is open, the stamp in its middle: motion blurs",
        le=0.1,
    )
    k1: Bend = port(
        _NONE, "Radial distortion that the calibration does not know: OpenCV's coefficient k1"
    )
    k2: Bend = port(_NONE, "The same, OpenCV's coefficient k2")


class RealityErrors(Value):
    """All of it, each field as it is.

    Attributes:
        links: Links of an arm; the others likewise.
    """

    links: LinkErrors = LinkErrors()
    payload: PayloadErrors = PayloadErrors()
    friction: FrictionErrors = FrictionErrors()
    encoder: EncoderErrors = EncoderErrors()
    drive: DriveErrors = DriveErrors()
    camera: CameraErrors = CameraErrors()


class RealitySpec(Value):
    """A set, and what differs from it: how far the plant is from what is believed of it."""

    set: RealityName | None = port(
        None, "Set that fields not given are taken from; by default the world's, there `ideal`"
    )
    links: LinkErrors = port(LinkErrors(), "Masses and inertias of the links")
    payload: PayloadErrors = port(PayloadErrors(), "What is held")
    friction: FrictionErrors = port(FrictionErrors(), "Friction of the joints")
    encoder: EncoderErrors = port(EncoderErrors(), "Encoders of the joints")
    drive: DriveErrors = port(DriveErrors(), "Drives of the joints")
    camera: CameraErrors = port(CameraErrors(), "The camera")

    def over(self, base: RealityErrors) -> RealityErrors:
        """What is given here, and all else as in ``base``."""
        merged = {
            name: _merged(getattr(base, name), getattr(self, name))
            for name in self.model_fields_set - {"set"}
        }
        return base.model_copy(update=merged)


def _merged(base: BaseModel, given: BaseModel) -> BaseModel:
    """The fields that were given, over those of the base."""
    changed = {name: getattr(given, name) for name in given.model_fields_set}
    return base.model_copy(update=changed)


Reality: TypeAlias = Annotated[
    Annotated[RealityName, Tag("name")] | Annotated[RealitySpec, Tag("value")],
    Discriminator(written_as),
]
"""A set by name, or a set with what differs from it."""


def resolved(
    world: Reality, arm: Reality | None, sets: Mapping[str, RealityErrors]
) -> RealityErrors:
    """What holds for an arm: the world's, and what the arm says over it.

    Args:
        world: Reality of the world.
        arm: Reality of the arm, None where it says nothing.
        sets: The sets by name.
    """
    base = sets["ideal"]
    for given in (world, arm):
        if isinstance(given, str):
            base = sets[given]
        elif given is not None:
            base = given.over(base if given.set is None else sets[given.set])
    return base
