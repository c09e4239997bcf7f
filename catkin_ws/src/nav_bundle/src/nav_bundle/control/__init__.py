"""Local planners: trajectory rollout and the dynamic window approach."""
