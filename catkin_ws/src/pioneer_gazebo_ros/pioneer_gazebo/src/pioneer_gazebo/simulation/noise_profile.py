"""Named profiles of the robots' noise, beside what each robot's description says."""

import dataclasses

from pioneer_gazebo.noise import Noise
from pioneer_gazebo.world.robot import LaserSensor


@dataclasses.dataclass(frozen=True, slots=True)
class NoiseProfile:
    """Least noise of every robot; a description may have more."""

    wheel_diameter: float = (
        0.0  #: standard deviation of the diameters that encoders assume, as a part of it
    )
    laser_stddev: float = 0.0  #: standard deviation of a range [m]
    laser_bias: float = 0.0  #: largest error that all ranges of a laser have in common [m]

    def applied(self, laser: LaserSensor, noise: Noise) -> LaserSensor:
        """Returns a laser with this noise; ``noise`` determines its common error."""
        bias = self.laser_bias * float(noise.at(0).uniform(-1.0, 1.0))
        return dataclasses.replace(
            laser,
            noise_mean=laser.noise_mean + bias,
            noise_stddev=max(laser.noise_stddev, self.laser_stddev),
        )


DESCRIBED = NoiseProfile()
"""The noise of the descriptions: perfect encoders, and 1 cm for the Pioneer's laser."""

REALISTIC = NoiseProfile(
    # A millimetre of the Pioneer's 195 mm: an assumption for tyres that are pumped by hand.
    wheel_diameter=0.005,
    # SICK's support portal, "Measurement errors LMSxxx": of an LMS1xx, typically 12 mm statistical and 30 mm
    # systematic error.
    laser_stddev=0.012,
    laser_bias=0.03,
)

PROFILES = {"described": DESCRIBED, "realistic": REALISTIC}
"""Profiles by their names."""
