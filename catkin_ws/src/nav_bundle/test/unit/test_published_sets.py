"""Published robots' parameters load unchanged, or the planner that they need is named; so is what has no effect.

The sets are our own files with the names and values of the robots' packages.
"""

import re
from dataclasses import dataclass
from typing import Any

import pytest
import yaml

from nav_bundle.check_parameters import flattened, read_as_nodes_do
from nav_bundle.check_planner import a_robot_follows_a_plan_to_its_goal_without_contact
from nav_bundle.move_base.config import setup_from_parameters


@dataclass(frozen=True)
class ParameterSet:
    """One robot's parameters of move_base."""

    robot: str
    kind: str  #: footprint and drive
    text: str  #: YAML in move_base's namespace
    common: str = ""  #: YAML in the namespaces of both costmaps
    warned: tuple[str, ...] = ()  #: parameters of which a node warns, by the end of their names
    refused: str = (
        ""  #: part of the message if the set needs a planner or layer that does not exist here
    )


_GLOBAL = """
global_costmap: {global_frame: map, robot_base_frame: base_link, update_frequency: 5.0, static_map: true}
local_costmap:
  {global_frame: odom, robot_base_frame: base_link, update_frequency: 5.0, publish_frequency: 2.0, static_map: false,
   rolling_window: true, width: 4.0, height: 4.0, resolution: 0.05}
"""

SETS = (
    ParameterSet(
        "TurtleBot 2",
        "round, differential",
        _GLOBAL
        + """
base_local_planner: dwa_local_planner/DWAPlannerROS
DWAPlannerROS:
  {max_vel_x: 0.3, min_vel_x: 0.0, max_vel_y: 0.0, min_vel_y: 0.0, max_rot_vel: 1.0, min_rot_vel: 0.4, acc_lim_x: 0.5,
   acc_lim_theta: 1.0, acc_lim_y: 0.0, yaw_goal_tolerance: 0.3, xy_goal_tolerance: 0.15, sim_time: 3.0, vx_samples: 6,
   vy_samples: 1, vtheta_samples: 20, path_distance_bias: 32.0, goal_distance_bias: 24.0, occdist_scale: 0.01,
   forward_point_distance: 0.325, stop_time_buffer: 0.2, scaling_speed: 0.25, max_scaling_factor: 0.2,
   oscillation_reset_dist: 0.05, publish_traj_pc: true, publish_cost_grid_pc: true, global_frame_id: odom}
""",
        """
max_obstacle_height: 0.60
robot_radius: 0.20
map_type: voxel
obstacle_layer:
  enabled: true
  max_obstacle_height: 0.6
  unknown_threshold: 15
  mark_threshold: 0
  combination_method: 1
  track_unknown_space: true
  obstacle_range: 2.5
  raytrace_range: 3.0
  origin_z: 0.0
  z_resolution: 0.2
  z_voxels: 2
  publish_voxel_map: false
  observation_sources: scan bump
  scan:
    {data_type: LaserScan, topic: scan, marking: true, clearing: true, min_obstacle_height: 0.25,
     max_obstacle_height: 0.35}
  bump:
    {data_type: PointCloud2, topic: mobile_base/sensors/bumper_pointcloud, marking: true, clearing: false,
     min_obstacle_height: 0.0, max_obstacle_height: 0.15}
inflation_layer: {enabled: true, cost_scaling_factor: 5.0, inflation_radius: 0.5}
static_layer: {enabled: true}
""",
        warned=("vtheta_samples", "publish_traj_pc", "global_frame_id"),
    ),
    ParameterSet(
        "TurtleBot 3 Waffle",
        "rectangle behind its axis, differential",
        _GLOBAL
        + """
base_local_planner: dwa_local_planner/DWAPlannerROS
DWAPlannerROS:
  {max_vel_x: 0.26, min_vel_x: -0.26, max_vel_y: 0.0, min_vel_y: 0.0, max_trans_vel: 0.26, min_trans_vel: 0.13,
   max_rot_vel: 1.82, min_rot_vel: 0.9, acc_lim_x: 2.5, acc_lim_y: 0.0, acc_lim_theta: 3.2, xy_goal_tolerance: 0.05,
   yaw_goal_tolerance: 0.17, latch_xy_goal_tolerance: false, sim_time: 2.0, vx_samples: 20, vy_samples: 0,
   vtheta_samples: 40, controller_frequency: 10.0, path_distance_bias: 32.0, goal_distance_bias: 20.0,
   occdist_scale: 0.02, forward_point_distance: 0.325, stop_time_buffer: 0.2, scaling_speed: 0.25,
   max_scaling_factor: 0.2, oscillation_reset_dist: 0.05, publish_traj_pc: true, publish_cost_grid_pc: true}
""",
        """
obstacle_range: 3.5
raytrace_range: 4.0
footprint: [[-0.205, -0.145], [-0.205, 0.145], [0.077, 0.145], [0.077, -0.145]]
inflation_radius: 0.20
map_type: costmap
transform_tolerance: 0.2
observation_sources: scan
scan: {data_type: LaserScan, topic: scan, marking: true, clearing: true}
""",
        warned=("vy_samples", "vtheta_samples", "publish_traj_pc"),
    ),
    ParameterSet(
        "Husky",
        "rectangle, skid steering",
        """
controller_frequency: 5.0
recovery_behaviour_enabled: true
NavfnROS: {allow_unknown: true, default_tolerance: 0.1}
TrajectoryPlannerROS:
  {acc_lim_x: 2.5, acc_lim_theta: 3.2, max_vel_x: 3.0, min_vel_x: 0.0, max_vel_theta: 1.0, min_vel_theta: -1.0,
   min_in_place_vel_theta: 0.2, holonomic_robot: false, escape_vel: -0.1, yaw_goal_tolerance: 0.1,
   xy_goal_tolerance: 0.2, latch_xy_goal_tolerance: false, sim_time: 2.0, sim_granularity: 0.02,
   angular_sim_granularity: 0.02, vx_samples: 6, vtheta_samples: 20, controller_frequency: 20.0, meter_scoring: true,
   occdist_scale: 0.1, pdist_scale: 0.75, gdist_scale: 1.0, heading_lookahead: 0.325, heading_scoring: false,
   heading_scoring_timestep: 0.8, dwa: true, simple_attractor: false, publish_cost_grid_pc: true,
   oscillation_reset_dist: 0.25, escape_reset_dist: 0.1, escape_reset_theta: 0.1}
DWAPlannerROS:
  {acc_lim_x: 2.5, acc_lim_y: 0, acc_lim_th: 3.2, max_vel_x: 3.0, min_vel_x: 0.0, max_vel_y: 0, min_vel_y: 0,
   max_trans_vel: 0.5, min_trans_vel: 0.1, max_rot_vel: 1.0, min_rot_vel: 0.2, yaw_goal_tolerance: 0.1,
   xy_goal_tolerance: 0.2, latch_xy_goal_tolerance: false}
local_costmap:
  global_frame: odom
  rolling_window: true
  plugins:
  - {name: obstacles_laser, type: "costmap_2d::ObstacleLayer"}
  - {name: inflation, type: "costmap_2d::InflationLayer"}
global_costmap:
  global_frame: map
  rolling_window: false
  track_unknown_space: true
  plugins:
  - {name: static, type: "costmap_2d::StaticLayer"}
  - {name: obstacles_laser, type: "costmap_2d::ObstacleLayer"}
  - {name: inflation, type: "costmap_2d::InflationLayer"}
""",
        """
footprint: [[-0.5, -0.33], [-0.5, 0.33], [0.5, 0.33], [0.5, -0.33]]
footprint_padding: 0.01
robot_base_frame: base_link
update_frequency: 4.0
publish_frequency: 3.0
transform_tolerance: 0.5
resolution: 0.05
obstacle_range: 5.5
raytrace_range: 6.0
static: {map_topic: /map, subscribe_to_updates: true}
obstacles_laser:
  observation_sources: laser
  laser: {data_type: LaserScan, clearing: true, marking: true, topic: scan, inf_is_valid: true}
inflation: {inflation_radius: 1.0}
""",
        warned=("recovery_behaviour_enabled",),
    ),
    ParameterSet(
        "Jackal",
        "rectangle, skid steering",
        _GLOBAL
        + """
TrajectoryPlannerROS:
  {acc_lim_x: 10.0, acc_lim_theta: 20.0, max_vel_x: 0.5, min_vel_x: 0.1, max_vel_theta: 1.57, min_vel_theta: -1.57,
   min_in_place_vel_theta: 0.314, holonomic_robot: false, escape_vel: -0.5, yaw_goal_tolerance: 0.157,
   xy_goal_tolerance: 0.25, latch_xy_goal_tolerance: false, sim_time: 2.0, sim_granularity: 0.02,
   angular_sim_granularity: 0.02, vx_samples: 6, vtheta_samples: 20, controller_frequency: 20.0, meter_scoring: true,
   occdist_scale: 0.1, pdist_scale: 0.75, gdist_scale: 1.0, heading_lookahead: 0.325, heading_scoring: false,
   heading_scoring_timestep: 0.8, dwa: true, simple_attractor: false, publish_cost_grid_pc: true,
   oscillation_reset_dist: 0.05, escape_reset_dist: 0.1, escape_reset_theta: 0.1}
""",
        """
map_type: costmap
origin_z: 0.0
z_resolution: 1
z_voxels: 2
obstacle_range: 2.5
raytrace_range: 3.0
publish_voxel_map: false
transform_tolerance: 0.5
meter_scoring: true
footprint: [[-0.21, -0.165], [-0.21, 0.165], [0.21, 0.165], [0.21, -0.165]]
footprint_padding: 0.1
plugins:
- {name: obstacles_layer, type: "costmap_2d::ObstacleLayer"}
- {name: footprint_layer, type: "costmap_2d::FootprintLayer"}
- {name: inflater_layer, type: "costmap_2d::InflationLayer"}
obstacles_layer:
  observation_sources: scan
  scan:
    {sensor_frame: front_laser, data_type: LaserScan, topic: scan, marking: true, clearing: true,
     min_obstacle_height: -2.0, max_obstacle_height: 2.0, obstacle_range: 2.5, raytrace_range: 3.0}
inflater_layer: {inflation_radius: 0.25}
""",
        warned=(
            "plugins",
            "map_type",
            "origin_z",
            "z_resolution",
            "z_voxels",
            "publish_voxel_map",
            "meter_scoring",
            "static_map",
        ),
    ),
    ParameterSet(
        "Fetch",
        "round, differential",
        _GLOBAL
        + """
base_global_planner: "navfn/NavfnROS"
base_local_planner: "base_local_planner/TrajectoryPlannerROS"
oscillation_timeout: 10.0
oscillation_distance: 0.5
planner_frequency: 0.0
planner_patience: 5.0
controller_frequency: 25.0
controller_patience: 15.0
NavfnROS:
  {allow_unknown: true, default_tolerance: 0.0, planner_window_x: 0.0, planner_window_y: 0.0,
   visualize_potential: false}
TrajectoryPlannerROS:
  {acc_lim_x: 0.35, acc_lim_y: 0.0, acc_lim_theta: 0.8, max_vel_x: 1.0, min_vel_x: 0.15, max_vel_y: 0.0,
   min_vel_y: 0.0, max_vel_theta: 1.5, min_vel_theta: -1.5, min_in_place_vel_theta: 0.3, holonomic_robot: false,
   yaw_goal_tolerance: 0.1, xy_goal_tolerance: 0.1, latch_xy_goal_tolerance: true, sim_time: 1.0,
   sim_granularity: 0.025, angular_sim_granularity: 0.025, vx_samples: 3, vtheta_samples: 10, meter_scoring: true,
   path_distance_bias: 0.5, goal_distance_bias: 0.75, occdist_scale: 0.00625, heading_lookahead: 0.325,
   heading_scoring_timestep: 0.8, heading_scoring: true, dwa: false, oscillation_reset_dist: 0.05,
   publish_cost_grid_pc: false}
recovery_behavior_enabled: true
recovery_behaviors:
- {name: conservative_reset, type: clear_costmap_recovery/ClearCostmapRecovery, reset_distance: 3.0}
- {name: rotate_recovery, type: rotate_recovery/RotateRecovery, frequency: 20.0, sim_granularity: 0.017}
- {name: aggressive_reset, type: clear_costmap_recovery/ClearCostmapRecovery, reset_distance: 0.5}
""",
        "robot_radius: 0.3\n",
        warned=("recovery_behaviors", "max_vel_y", "min_vel_y"),
    ),
    ParameterSet(
        "linorobot with mecanum wheels",
        "rectangle, holonomic",
        _GLOBAL
        + """
TrajectoryPlannerROS:
  {max_vel_x: 0.35, min_vel_x: 0.3, max_vel_theta: 0.5, min_vel_theta: -0.5, min_in_place_vel_theta: 0.6,
   acc_lim_theta: 0.6, acc_lim_x: 1.25, acc_lim_y: 0.0, xy_goal_tolerance: 0.25, yaw_goal_tolerance: 0.25,
   holonomic_robot: true}
""",
        """
obstacle_range: 2.5
raytrace_range: 3.0
footprint: [[-0.24, -0.22], [-0.24, 0.22], [0.24, 0.22], [0.24, -0.22]]
inflation_radius: 0.3
transform_tolerance: 0.13
observation_sources: scan
scan: {data_type: LaserScan, topic: scan, marking: true, clearing: true}
map_type: costmap
""",
    ),
    ParameterSet(
        "Summit XL",
        "rectangle, holonomic",
        """
TrajectoryPlannerROS:
  {acc_lim_x: 2.5, acc_lim_y: 2.5, acc_lim_theta: 3.2, max_vel_x: 1.0, min_vel_x: 0.025, max_vel_theta: 1.0,
   min_vel_theta: -1.0, min_in_place_rotational_vel: 0.2, escape_vel: -0.1, holonomic_robot: true,
   y_vels: [-0.3, -0.1, 0.1, 0.3], yaw_goal_tolerance: 0.15, xy_goal_tolerance: 0.2, latch_xy_goal_tolerance: true,
   sim_time: 1.0, sim_granularity: 0.025, angular_sim_granularity: 0.025, vx_samples: 3, vtheta_samples: 20,
   meter_scoring: false, pdist_scale: 1.0, gdist_scale: 0.01, occdist_scale: 0.01, heading_lookahead: 0.325,
   heading_scoring: false, heading_scoring_timestep: 0.1, dwa: false, publish_cost_grid_pc: false,
   global_frame_id: odom, oscillation_reset_dist: 0.05, prune_plan: true}
local_costmap: {global_frame: odom, robot_base_frame: base_footprint, rolling_window: true}
global_costmap:
  global_frame: map
  robot_base_frame: base_footprint
  update_frequency: 5.0
  rolling_window: false
  width: 200.0
  height: 200.0
  resolution: 0.05
  origin_x: -100.0
  origin_y: -100.0
  plugins:
  - {name: static_map, type: "costmap_2d::StaticLayer"}
  static_map:
    {enabled: true, lethal_cost_threshold: 94, map_topic: "/map", unknown_cost_value: -1, trinary_costmap: false,
     use_maximum: false, first_map_only: false}
""",
        """
obstacle_range: 2.5
raytrace_range: 3.0
footprint: [[0.35, -0.3], [0.35, 0.3], [-0.35, 0.3], [-0.35, -0.3]]
publish_frequency: 1.0
inflation_layer: {inflation_radius: 0.5}
obstacle_layer:
  observation_sources: hokuyo_laser
  hokuyo_laser:
    {sensor_frame: hokuyo_base_link, data_type: LaserScan, topic: hokuyo_base/scan, marking: true, clearing: true}
""",
        warned=("obstacle_range", "raytrace_range", "global_frame_id"),
    ),
    ParameterSet(
        "TIAGo",
        "round, differential",
        """
recovery_behaviors:
- {name: aggressive_reset, type: clear_costmap_recovery/ClearCostmapRecovery}
- {name: rotate, type: rotate_recovery/RotateRecovery}
aggressive_reset: {reset_distance: 1.5, layer_names: [obstacle_laser_layer, obstacle_rgbd_layer]}
rotate: {max_rotational_vel: 0.6}
local_costmap:
  map_type: costmap
  global_frame: odom
  robot_base_frame: base_footprint
  transform_tolerance: 0.2
  update_frequency: 5.0
  publish_frequency: 2.0
  static_map: false
  rolling_window: true
  width: 5.0
  height: 5.0
  resolution: 0.05
  robot_radius: 0.25
  plugins:
  - {name: obstacle_laser_layer, type: "costmap_2d::ObstacleLayer"}
  - {name: obstacle_rgbd_layer, type: "costmap_2d::ObstacleLayer"}
  - {name: obstacle_sonar_layer, type: "costmap_2d::ObstacleLayer"}
  - {name: inflation_layer, type: "costmap_2d::InflationLayer"}
  obstacle_laser_layer:
    enabled: true
    observation_sources: base_scan
    combination_method: 1
    base_scan:
      {sensor_frame: base_laser_link, data_type: LaserScan, topic: scan, expected_update_rate: 0.3,
       observation_persistence: 1.0, inf_is_valid: true, marking: true, clearing: true, raytrace_range: 3.0,
       obstacle_range: 2.5, min_obstacle_height: -0.1, max_obstacle_height: 0.2}
  obstacle_rgbd_layer:
    enabled: true
    observation_sources: rgbd_scan
    combination_method: 1
    rgbd_scan:
      {sensor_frame: base_footprint, data_type: LaserScan, topic: rgbd_scan, expected_update_rate: 0.5,
       observation_persistence: 0.0, inf_is_valid: true, marking: true, clearing: true, raytrace_range: 3.5,
       obstacle_range: 3.2, blanking_range: 0.5, min_obstacle_height: -0.1, max_obstacle_height: 0.2, debug: true}
  obstacle_sonar_layer:
    enabled: false
    observation_sources: sonar_cloud sonar_max_range_cloud
    combination_method: 1
    sonar_cloud:
      {sensor_frame: base_link, data_type: PointCloud2, topic: sonar_cloud, expected_update_rate: 1.0,
       observation_persistence: 0.0, marking: true, clearing: true, raytrace_range: 3.0, obstacle_range: 2.5,
       min_obstacle_height: 0.1, max_obstacle_height: 1.8}
    sonar_max_range_cloud:
      {sensor_frame: base_link, data_type: PointCloud2, topic: sonar_max_range_cloud, expected_update_rate: 1.0,
       observation_persistence: 0.0, marking: false, clearing: true, raytrace_range: 4.5, obstacle_range: 3.0,
       min_obstacle_height: 0.1, max_obstacle_height: 1.8}
  inflation_layer: {enabled: true, inflation_radius: 0.3, cost_scaling_factor: 2.0}
""",
        warned=("map_type", "static_map", "blanking_range", "debug"),
    ),
    ParameterSet(
        "MiR 100",
        "rectangle ahead of its axis, differential",
        """
base_local_planner: dwa_local_planner/DWAPlannerROS
DWAPlannerROS:
  {max_vel_x: 0.8, min_vel_x: -0.2, max_vel_y: 0.0, min_vel_y: 0.0, max_trans_vel: 0.8, min_trans_vel: 0.1,
   trans_stopped_vel: 0.03, max_rot_vel: 1.0, min_rot_vel: 0.1, rot_stopped_vel: 0.1, acc_lim_x: 1.5, acc_lim_y: 0.0,
   acc_limit_trans: 1.5, acc_lim_theta: 2.0, yaw_goal_tolerance: 0.03, xy_goal_tolerance: 0.08,
   latch_xy_goal_tolerance: true, sim_time: 1.2, vx_samples: 15, vy_samples: 1, vtheta_samples: 20,
   path_distance_bias: 64.0, goal_distance_bias: 12.0, occdist_scale: 0.5, forward_point_distance: 0.325,
   stop_time_buffer: 0.2, scaling_speed: 0.25, max_scaling_factor: 0.2, prune_plan: true,
   oscillation_reset_dist: 0.05, oscillation_reset_angle: 0.2, publish_traj_pc: true, publish_cost_grid_pc: true,
   global_frame_id: /odom_comb}
local_costmap:
  global_frame: odom_comb
  rolling_window: true
  plugins:
  - {name: obstacles, type: "costmap_2d::VoxelLayer"}
  - {name: inflation, type: "costmap_2d::InflationLayer"}
global_costmap:
  global_frame: map
  plugins:
  - {name: navigation_map, type: "costmap_2d::StaticLayer"}
  - {name: obstacles, type: "costmap_2d::VoxelLayer"}
  - {name: virtual_walls_map, type: "costmap_2d::StaticLayer"}
  - {name: inflation, type: "costmap_2d::InflationLayer"}
""",
        """
robot_base_frame: base_footprint
transform_tolerance: 0.4
update_frequency: 5.0
publish_frequency: 1.0
footprint: [[0.506, -0.32], [0.506, 0.32], [-0.454, 0.32], [-0.454, -0.32]]
footprint_padding: 0.0
obstacle_range: 3.0
publish_voxel_map: true
navigation_map: {map_topic: /map, first_map_only: true}
obstacles:
  observation_sources: b_scan_marking b_scan_clearing
  b_scan_marking:
    {topic: b_scan_rep117, data_type: LaserScan, clearing: false, marking: true, inf_is_valid: false,
     min_obstacle_height: 0.13, max_obstacle_height: 0.25}
  b_scan_clearing:
    {topic: b_scan_rep117, data_type: LaserScan, clearing: true, marking: false, inf_is_valid: false,
     min_obstacle_height: 0.13, max_obstacle_height: 0.25}
virtual_walls_map: {map_topic: /virtual_walls/map, first_map_only: true, use_maximum: true}
""",
        warned=(
            "publish_voxel_map",
            "vtheta_samples",
            "publish_traj_pc",
            "global_frame_id",
            "acc_lim_trans",
        ),
    ),
    ParameterSet(
        "robot of the Udacity RoboND course",
        "default footprint, differential",
        """
controller_frequency: 15
TrajectoryPlannerROS: {holonomic_robot: false, max_vel_x: .15, sim_time: 6.0, controller_frequency: 9}
local_costmap:
  {global_frame: odom, robot_base_frame: robot_footprint, update_frequency: 5.0, publish_frequency: 5.0, width: 5.0,
   height: 5.0, resolution: 0.01, static_map: false, rolling_window: true}
""",
        """
map_type: costmap
obstacle_range: 2.5
raytrace_range: 3.0
transform_tolerance: .2
cost_scaling_factor: 3.5
inflation_radius: .76
observation_sources: laser_scan_sensor
laser_scan_sensor:
  {sensor_frame: hokuyo, data_type: LaserScan, topic: /udacity_bot/laser/scan, marking: true, clearing: true}
""",
    ),
    ParameterSet(
        "Laelaps",
        "rectangle, skid steering",
        _GLOBAL
        + """
TrajectoryPlannerROS:
  {max_vel_x: 2.5, min_vel_x: 0.1, max_vel_theta: 2.5, min_in_place_vel_theta: 0.1, acc_lim_theta: 5.0,
   acc_lim_x: 10.0, acc_lim_y: 10.0, escape_vel: -1.0, yaw_goal_tolerance: 0.25, xy_goal_tolerance: 0.5,
   holonomic_robot: false, dwa: true, publish_cost_grid_pc: true, meter_scoring: true, pdist_scale: 0.6,
   gdist_scale: 0.8, occdist_scale: 0.01, heading_scoring: true, heading_lookahead: 1.0}
""",
        """
obstacle_range: 3.0
raytrace_range: 3.0
footprint: [[-0.175, 0.125], [0.175, 0.125], [0.175, -0.125], [-0.175, -0.125]]
inflation_radius: 5.0
observation_sources: pointcloud_scan_sensor laser_scan_sensor
pointcloud_scan_sensor:
  {sensor_frame: base_footprint, data_type: LaserScan, topic: /scan_from_pointcloud, marking: true, clearing: false}
laser_scan_sensor: {sensor_frame: laser_0, data_type: LaserScan, topic: /scan, marking: true, clearing: false}
""",
    ),
    ParameterSet(
        "Seekur Jr",
        "rectangle, skid steering",
        _GLOBAL,
        """
footprint: [[0.6, -0.42], [0.6, 0.42], [-0.6, 0.42], [-0.6, -0.42]]
footprint_padding: 0.01
publish_frequency: 3.0
update_frequency: 4.0
obstacle_range: 2.5
raytrace_range: 3.0
transform_tolerance: 0.5
obstacle_layer:
  enabled: true
  unknown_threshold: 15
  mark_threshold: 0
  combination_method: 1
  track_unknown_space: true
  observation_sources: scan
  scan: {data_type: LaserScan, topic: scan_filtered, marking: true, clearing: true, inf_is_valid: true}
inflation_layer: {enabled: true, cost_scaling_factor: 2.58, inflation_radius: 1.75}
static_layer: {map_topic: map, enabled: true, subscribe_to_updates: true}
""",
        warned=("unknown_threshold", "mark_threshold"),
    ),
    ParameterSet(
        "RB-1 Base",
        "octagon, differential",
        """
local_costmap:
  global_frame: odom
  robot_base_frame: base_footprint
  rolling_window: true
  plugins:
  - {name: obstacle_layer, type: "costmap_2d::VoxelLayer"}
  - {name: rgbd_obstacle_layer, type: "costmap_2d::VoxelLayer"}
  - {name: inflation_layer, type: "costmap_2d::InflationLayer"}
""",
        """
publish_frequency: 1.0
footprint:
  [[0.25, 0.0], [0.177, 0.177], [0.0, 0.25], [-0.177, 0.177], [-0.25, 0.0], [-0.177, -0.177], [0.0, -0.25],
   [0.177, -0.177]]
inflation_layer: {inflation_radius: 0.3}
obstacle_layer:
  obstacle_range: 2.5
  raytrace_range: 5.5
  observation_sources: front_laser
  front_laser:
    {sensor_frame: robot_front_laser_link, data_type: LaserScan, topic: front_laser/scan, marking: true,
     clearing: true, observation_persistence: 0.0}
rgbd_obstacle_layer:
  obstacle_range: 2.5
  raytrace_range: 5.5
  observation_sources: front_rgbd_to_scan
  front_rgbd_to_scan:
    {data_type: LaserScan, topic: front_rgbd_camera/point_cloud_scan_filtered, marking: true, clearing: true,
     observation_persistence: 5.0}
""",
    ),
    ParameterSet(
        "Scout mini",
        "rectangle, skid steering",
        "base_local_planner: teb_local_planner/TebLocalPlannerROS\n",
        """
footprint: [[0.31, -0.29], [0.31, 0.29], [-0.31, 0.29], [-0.31, -0.29]]
update_frequency: 10.0
publish_frequency: 10.0
obstacle_layer:
  observation_sources: scan rgbd_camera
  scan:
    {topic: scan, sensor_frame: laser_link, data_type: LaserScan, clearing: true, marking: true, obstacle_range: 15.0,
     raytrace_range: 20.0, inf_is_valid: true, min_obstacle_height: 0.1, max_obstacle_height: 2.0}
  rgbd_camera:
    {topic: camera/depth_registered/points, sensor_frame: camera_color_optical_frame, data_type: PointCloud2,
     clearing: true, marking: true, obstacle_range: 5.0, raytrace_range: 6.0, inf_is_valid: true,
     min_obstacle_height: 0.25, max_obstacle_height: 0.25}
""",
        refused="teb_local_planner/TebLocalPlannerROS",
    ),
)


by_robot = pytest.mark.parametrize("robot", SETS, ids=lambda one: one.robot)


def parameters_of(robot: ParameterSet) -> dict[str, Any]:
    """Returns all parameters as launch files load them: those in common first."""
    found: dict[str, Any] = {}
    for costmap in ("global_costmap", "local_costmap"):
        found.update(flattened(f"move_base/{costmap}", yaml.safe_load(robot.common) or {}))
    return {**found, **flattened("move_base", yaml.safe_load(robot.text))}


@by_robot
def test_a_published_set_is_taken(robot: ParameterSet) -> None:
    refused, _ = read_as_nodes_do(parameters_of(robot))
    if robot.refused:
        [text] = refused
        assert robot.refused in text
    else:
        assert refused == []


@by_robot
def test_what_has_no_effect_in_a_published_set_is_named(robot: ParameterSet) -> None:
    _, warnings = read_as_nodes_do(parameters_of(robot))
    named = {
        match[1].split("/")[-1] for text in warnings if (match := re.search(r"~([\w/]+)", text))
    }
    assert named == set(robot.warned), warnings


@pytest.mark.parametrize(
    "robot", [one for one in SETS if not one.refused], ids=lambda one: one.robot
)
def test_a_published_set_drives_to_its_goal(robot: ParameterSet) -> None:
    """Its local planner drives 4 m in a room, in the costmap of a round robot."""
    own, common = yaml.safe_load(robot.text), yaml.safe_load(robot.common) or {}
    costmaps = {
        name: {**common, **own.get(name, {})} for name in ("global_costmap", "local_costmap")
    }
    setup = setup_from_parameters({**own, **costmaps}, "move_base")
    a_robot_follows_a_plan_to_its_goal_without_contact(
        lambda *_: setup.make_local_planner()  # type: ignore[arg-type]
    )
