"""What a planner learns in flight: power, period, time, charge."""
