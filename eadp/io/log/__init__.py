"""Power logs in: CSV, PX4 ULog, ArduPilot DataFlash."""
