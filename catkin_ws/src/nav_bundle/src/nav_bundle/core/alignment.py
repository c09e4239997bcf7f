"""The last centimetres: an estimate moved to where its scan lies best on the map.

A particle filter with amcl's blunt likelihoods follows the robot some 5 to 10 cm behind, the more the worse the
odometry. Its estimate is a good start for a least-squares fit of the scan to the map, within the filter's spread. A few
particles move to where the scan fits, so that the cloud does not fall farther behind.
"""

import numpy as np

from nav_bundle.core.particle import Estimate
from nav_bundle.core.pose import Pose, angle_difference
from nav_bundle.core.sensor import Beams, DistanceField
from nav_bundle.kernels.alignment import align

SIGMA = 0.1
"""Spread of hits about obstacles [m]; what is three times as far from any is taken for something unmapped."""
PRIOR_FLOOR = 0.1
"""Standard deviation [m], [rad] added to the particles' spread: they can all be wrong by that."""
ITERATIONS = 10
LEAST_AGREEMENT = 0.4
"""Share of the beams that must lie on obstacles for the fit to be believed."""
FARTHEST = 0.5
"""A fit that moves the estimate further [m], [rad] found another place."""


def refined(estimate: Estimate, beams: Beams, field: DistanceField) -> tuple[Pose, float]:
    """Returns the pose near the estimate's at which the beams fit the map best, and the share of them that do.

    The pose is the estimate's own where too few fit.
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
