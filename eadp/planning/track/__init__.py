"""Where a live flight is in its plan: samples of telemetry to observations, decisions to advice."""
