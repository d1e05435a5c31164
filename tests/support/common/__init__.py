"""What several tests need: plans, a planner that is watched."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
"""The repository's root."""
