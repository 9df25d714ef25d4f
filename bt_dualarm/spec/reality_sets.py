"""The named realities; docs/reality.md has the source or the reason of each number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from bt_dualarm.spec.reality import (
    CameraErrors,
    DriveErrors,
    EncoderErrors,
    FrictionErrors,
    LinkErrors,
    PayloadErrors,
    RealityErrors,
)
from bt_dualarm.spec.spread import Spread

_LAB: Final = RealityErrors(
    links=LinkErrors(
        mass=Spread(uniform=0.05),
        inertia=Spread(uniform=0.05),
        center=Spread(uniform=0.002),
        rotor=True,
    ),
    payload=PayloadErrors(known=True, mass=Spread(uniform=0.02), center=Spread(uniform=0.002)),
    friction=FrictionErrors(
        present=True, coulomb=Spread(uniform=0.3), viscous=Spread(uniform=0.3), most=0.07
    ),
    encoder=EncoderErrors(resolution=360 / 2**19, noise=3e-4, window=0.004, cutoff=80.0),
    drive=DriveErrors(delay=0.001, bandwidth=500.0, quantum=1 / 2**12, gain=Spread(uniform=0.02)),
    camera=CameraErrors(
        position=Spread(uniform=0.001),
        rotation=Spread(uniform=0.3),
        focal=Spread(uniform=0.002),
        stamp=Spread(uniform=0.0005),
        noise=2.0,
        light=Spread(uniform=0.02),
        exposure=0.004,
        k1=Spread(uniform=0.005),
        k2=Spread(uniform=0.01),
    ),
)

_ROUGH: Final = RealityErrors(
    links=LinkErrors(
        mass=Spread(uniform=0.2),
        inertia=Spread(uniform=0.2),
        center=Spread(uniform=0.005),
        rotor=True,
    ),
    payload=PayloadErrors(known=False, mass=Spread(uniform=0.1), center=Spread(uniform=0.005)),
    friction=FrictionErrors(
        present=True, coulomb=Spread(uniform=0.6), viscous=Spread(uniform=0.6), most=0.07
    ),
    encoder=EncoderErrors(resolution=360 / 2**17, noise=1e-3, window=0.004, cutoff=80.0),
    drive=DriveErrors(delay=0.003, bandwidth=200.0, quantum=1 / 2**10, gain=Spread(uniform=0.05)),
    camera=CameraErrors(
        position=Spread(uniform=0.003),
        rotation=Spread(uniform=1.0),
        focal=Spread(uniform=0.01),
        stamp=Spread(uniform=0.002),
        noise=5.0,
        light=Spread(uniform=0.1),
        exposure=0.01,
        k1=Spread(uniform=0.02),
        k2=Spread(uniform=0.03),
    ),
)

REALITY_SETS: Final[Mapping[str, RealityErrors]] = {
    "ideal": RealityErrors(),
    "lab": _LAB,
    "rough": _ROUGH,
}
"""The sets by name: the model itself, a well kept robot, a neglected one."""
