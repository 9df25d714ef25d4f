"""Model mismatch: how far the simulated arm, sensors and drives deviate from the nominal model.

Each uncertainty is sampled with the seed, once for each arm: a seed is one robot of the batch.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import BaseModel, Discriminator, Tag

from bt_dualarm.spec.ports import port
from bt_dualarm.spec.problems import written_as
from bt_dualarm.spec.values import (
    Bend,
    Degrees,
    Duration,
    Meters,
    Seconds,
    Share,
    Uncertainty,
    Value,
)

RealityName: TypeAlias = Literal["ideal", "lab", "rough"]

REALITY_NAMES: Final[tuple[RealityName, ...]] = ("ideal", "lab", "rough")
"""Names of the sets, from the nominal model to a neglected robot."""

_NONE: Final = Uncertainty()


class LinkErrors(Value):
    """Errors of the links against the robot's description."""

    mass: Share = port(_NONE, "Relative error of a link's mass, sampled per link")
    inertia: Share = port(
        _NONE, "Relative error of a link's moments of inertia, in addition to that of its mass"
    )
    center: Meters = port(_NONE, "Offset of a link's center of mass along each axis", unit="m")
    rotor: bool = port(
        False,
        "Whether joints have the reflected inertia of their motors, which URDFs leave out; with "
        "the relative error of other inertia",
    )


class PayloadErrors(Value):
    """Errors of a held object against the file; the world's hold for the masses of objects."""

    known: bool = port(True, "Whether the controller knows mass and center of a held object")
    mass: Share = port(_NONE, "Relative error of an object's mass")
    center: Meters = port(_NONE, "Offset of an object's center of mass along each axis", unit="m")


class FrictionErrors(Value):
    """Friction of the joints as in the robot's description, and its errors."""

    present: bool = port(False, "Whether the joints have friction")
    coulomb: Share = port(_NONE, "Relative error of the dry friction, sampled per joint")
    viscous: Share = port(_NONE, "Relative error of the viscous friction, sampled per joint")
    most: float = port(
        1.0, "Largest dry friction, as a fraction of the joint's effort limit", ge=0.0, le=1.0
    )


class EncoderErrors(Value):
    """Errors of the joints' encoders, and the filter that derives velocities."""

    resolution: float = port(0.0, "Resolution of a reading; 0: exact", unit="deg", ge=0.0, le=1.0)
    noise: float = port(
        0.0, "Standard deviation of the noise of a reading", unit="deg", ge=0.0, le=1.0
    )
    window: Duration = port(
        0.0,
        "Time between the two readings whose difference gives a velocity; 0: exact velocity",
        le=0.1,
    )
    cutoff: float = port(
        0.0,
        "Corner frequency of the velocity's low-pass filter; 0: no filter",
        unit="Hz",
        ge=0.0,
        le=1e4,
    )


class DriveErrors(Value):
    """Dynamics and errors of the drives between a commanded torque and the joint."""

    delay: Duration = port(0.0, "Delay from commanding a torque to its effect", le=0.05)
    bandwidth: float = port(
        0.0, "Corner frequency of the drive's first-order lag; 0: no lag", unit="Hz", ge=0.0, le=1e5
    )
    quantum: float = port(
        0.0, "Resolution of a torque, as a fraction of the effort limit; 0: exact", ge=0.0, le=0.1
    )
    gain: Share = port(_NONE, "Relative error of a joint's torque, sampled per joint")


class CameraErrors(Value):
    """Errors of a camera against its calibration, and noise and blur of its images."""

    position: Meters = port(_NONE, "Offset of the camera along each of its axes", unit="m")
    rotation: Degrees = port(_NONE, "Rotation of the camera about each of its axes", unit="deg")
    focal: Share = port(_NONE, "Relative error of the focal length")
    stamp: Seconds = port(_NONE, "Offset of the clock of its time stamps", unit="s")
    noise: float = port(
        0.0, "Standard deviation of a pixel's noise, of 255 levels", ge=0.0, le=100.0
    )
    light: Share = port(_NONE, "Relative change of the brightness, sampled per image")
    exposure: Duration = port(
        0.0,
        "Exposure time, centered on the time stamp; causes motion blur",
        le=0.1,
    )
    k1: Bend = port(
        _NONE, "Radial distortion that the calibration does not know: OpenCV's coefficient k1"
    )
    k2: Bend = port(_NONE, "The same, OpenCV's coefficient k2")


class RealityErrors(Value):
    """Resolved model mismatch of an arm, with a value for every field."""

    links: LinkErrors = LinkErrors()
    payload: PayloadErrors = PayloadErrors()
    friction: FrictionErrors = FrictionErrors()
    encoder: EncoderErrors = EncoderErrors()
    drive: DriveErrors = DriveErrors()
    camera: CameraErrors = CameraErrors()


class RealitySpec(Value):
    """Model mismatch: a set, and the fields that differ from it."""

    set: RealityName | None = port(
        None,
        "Set that provides the other fields; by default that of the world, or `ideal` there",
    )
    links: LinkErrors = port(LinkErrors(), "Masses and inertias of the links")
    payload: PayloadErrors = port(PayloadErrors(), "A held object")
    friction: FrictionErrors = port(FrictionErrors(), "Friction of the joints")
    encoder: EncoderErrors = port(EncoderErrors(), "Encoders of the joints")
    drive: DriveErrors = port(DriveErrors(), "Drives of the joints")
    camera: CameraErrors = port(CameraErrors(), "The camera")

    def over(self, base: RealityErrors) -> RealityErrors:
        """Returns ``base`` with the fields that were given here."""
        merged: dict[str, BaseModel] = {}
        for name in self.model_fields_set - {"set"}:
            given: BaseModel = getattr(self, name)
            part: BaseModel = getattr(base, name)
            changed = {field: getattr(given, field) for field in given.model_fields_set}
            merged[name] = part.model_copy(update=changed)
        return base.model_copy(update=merged)


Reality: TypeAlias = Annotated[
    Annotated[RealityName, Tag("name")] | Annotated[RealitySpec, Tag("value")],
    Discriminator(written_as),
]
"""Name of a set, or a set with the fields that differ from it."""


def resolved(
    world: Reality, arm: Reality | None, sets: Mapping[str, RealityErrors]
) -> RealityErrors:
    """Returns the model mismatch of an arm: the world's, with the arm's own over it.

    Args:
        world: Model mismatch of the world.
        arm: Model mismatch of the arm, None if it has none of its own.
        sets: Sets by name.
    """
    base = sets["ideal"]
    for given in (world, arm):
        if isinstance(given, str):
            base = sets[given]
        elif given is not None:
            base = given.over(base if given.set is None else sets[given.set])
    return base


# Sets by name; docs/reality.md has the source or the reason of each number.


_LAB: Final = RealityErrors(
    links=LinkErrors(
        mass=Uncertainty(uniform=0.05),
        inertia=Uncertainty(uniform=0.05),
        center=Uncertainty(uniform=0.002),
        rotor=True,
    ),
    payload=PayloadErrors(
        known=True, mass=Uncertainty(uniform=0.02), center=Uncertainty(uniform=0.002)
    ),
    friction=FrictionErrors(
        present=True, coulomb=Uncertainty(uniform=0.3), viscous=Uncertainty(uniform=0.3), most=0.07
    ),
    encoder=EncoderErrors(resolution=360 / 2**19, noise=3e-4, window=0.004, cutoff=80.0),
    drive=DriveErrors(
        delay=0.001, bandwidth=500.0, quantum=1 / 2**12, gain=Uncertainty(uniform=0.02)
    ),
    camera=CameraErrors(
        position=Uncertainty(uniform=0.001),
        rotation=Uncertainty(uniform=0.3),
        focal=Uncertainty(uniform=0.002),
        stamp=Uncertainty(uniform=0.0005),
        noise=2.0,
        light=Uncertainty(uniform=0.02),
        exposure=0.004,
        k1=Uncertainty(uniform=0.005),
        k2=Uncertainty(uniform=0.01),
    ),
)

_ROUGH: Final = RealityErrors(
    links=LinkErrors(
        mass=Uncertainty(uniform=0.2),
        inertia=Uncertainty(uniform=0.2),
        center=Uncertainty(uniform=0.005),
        rotor=True,
    ),
    payload=PayloadErrors(
        known=False, mass=Uncertainty(uniform=0.1), center=Uncertainty(uniform=0.005)
    ),
    friction=FrictionErrors(
        present=True, coulomb=Uncertainty(uniform=0.6), viscous=Uncertainty(uniform=0.6), most=0.07
    ),
    encoder=EncoderErrors(resolution=360 / 2**17, noise=1e-3, window=0.004, cutoff=80.0),
    drive=DriveErrors(
        delay=0.003, bandwidth=200.0, quantum=1 / 2**10, gain=Uncertainty(uniform=0.05)
    ),
    camera=CameraErrors(
        position=Uncertainty(uniform=0.003),
        rotation=Uncertainty(uniform=1.0),
        focal=Uncertainty(uniform=0.01),
        stamp=Uncertainty(uniform=0.002),
        noise=5.0,
        light=Uncertainty(uniform=0.1),
        exposure=0.01,
        k1=Uncertainty(uniform=0.02),
        k2=Uncertainty(uniform=0.03),
    ),
)

REALITY_SETS: Final[Mapping[str, RealityErrors]] = {
    "ideal": RealityErrors(),
    "lab": _LAB,
    "rough": _ROUGH,
}
"""Sets by name: the nominal model, a well-kept robot, a neglected one."""
