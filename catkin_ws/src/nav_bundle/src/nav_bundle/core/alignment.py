"""Refines amcl's pose estimate by a least-squares fit of the scan to the map.

amcl's likelihoods are broad, so its estimate lags behind the robot by about 5 to 10 cm, more with poor odometry. The
estimate is a good starting point for the fit, which stays within the filter's spread. The filter then moves a few
particles to the fitted pose so that the cloud does not lag further behind.
"""

import numpy as np

from nav_bundle.core.particle import Estimate
from nav_bundle.core.pose import Pose, angle_difference
from nav_bundle.core.sensor import Beams, DistanceField
from nav_bundle.kernels.alignment import align

SIGMA = 0.1
"""Standard deviation of hits about obstacles [m]; a hit farther than three times this counts as unmapped."""
PRIOR_FLOOR = 0.1
"""Standard deviation [m], [rad] added to the particles' spread, because all particles can share an error this large."""
ITERATIONS = 10
LEAST_AGREEMENT = 0.4
"""Share of the beams that must hit mapped obstacles for the fit to be accepted."""
FARTHEST = 0.5
"""A fit that moves the estimate farther than this [m], [rad] is rejected: it found another place."""


def refined(estimate: Estimate, beams: Beams, field: DistanceField) -> tuple[Pose, float]:
    """Returns the pose near the estimate at which the beams fit the map best, and the share of beams that fit.

    Returns the estimate's own pose if too few beams fit or the fit moved too far.
    """
    points = np.ascontiguousarray(beams.end_points())
    if len(points) == 0:
        return estimate.pose, 0.0
    prior = estimate.cluster_covariance + np.eye(3) * PRIOR_FLOOR**2
    information = np.ascontiguousarray(np.linalg.inv(prior) * SIGMA**2)
    start, found = np.array([estimate.pose.x, estimate.pose.y, estimate.pose.yaw]), np.empty(3)
    agreement = align(start, points, field.cells, information, SIGMA, ITERATIONS, found)
    pose = Pose(*found.tolist())
    near = pose.distance(estimate.pose) < FARTHEST
    near = near and abs(angle_difference(pose.yaw, estimate.pose.yaw)) < FARTHEST
    return pose if near and agreement >= LEAST_AGREEMENT else estimate.pose, agreement
