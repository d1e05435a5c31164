"""What several tests need: plans, a planner that is watched."""
