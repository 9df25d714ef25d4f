"""How briskly an arm follows what its camera shows: as images, and its own jerk, allow."""

from __future__ import annotations

from dataclasses import dataclass

from bt_dualarm.world.cameras.guarded_camera import GuardedCamera

_BANDWIDTH = (40.0, 230.0)  # rad/s, least and most
_BANDWIDTH_PER_FPS = 5.0  # above it the noise of the estimate is followed, below it the target lags
_OLD_S = 0.06  # latency that halves the bandwidth
_SHAKY_PX = 0.7  # shake that does
_SLACK_M = 1.5e-4  # with a perfect camera
_CALM = 0.2  # with a perfect camera and jerk enough
_CALM_JERK = (1e-2, 2e-3)  # m²/s⁵, with a perfect camera, and the least


@dataclass(frozen=True)
class Briskness:
    """What servo and estimate are told.

    Attributes:
        bandwidth: The most with which the servo follows, in rad/s.
        slack: Jump of the estimate in m for which it may take all of the arm's jerk.
        calmness: How easily a target is taken to be calm, from 0 to 1.
        calm_jerk: Density of the jerk of a calm target, in m²/s⁵: its filter's bandwidth goes with
            the sixth root, and older images bear less of it.
    """

    bandwidth: float
    slack: float
    calmness: float
    calm_jerk: float


def briskness(camera: GuardedCamera, jerk: float) -> Briskness:
    """The less, the rarer, the older and the shakier the images are.

    Args:
        camera: Camera of the arm.
        jerk: What the joints allow in the plane, in m/s³.
    """
    from bt_dualarm.motion.setpoints.following_kernels import jerk_bandwidth

    doubt = 1.0 + camera.noise / _SHAKY_PX + (camera.latency / _OLD_S) ** 2
    least, most = _BANDWIDTH
    bandwidth = max(least, min(most, _BANDWIDTH_PER_FPS / camera.period) / doubt)
    slack = _SLACK_M * doubt**3
    lack = bandwidth / jerk_bandwidth(jerk, slack) - 1.0
    calm_jerk, least_jerk = _CALM_JERK
    return Briskness(
        bandwidth,
        slack,
        calmness=min(max(lack, _CALM * doubt**3), 1.0),
        calm_jerk=max(calm_jerk / doubt**6, least_jerk),
    )
