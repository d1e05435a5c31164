"""Flight I: steps per CPU second with filter and log, beside a direct transcription with matrices.

    python benchmarks/flight.py [--runs 5] [--peer-steps 5000] [--write]

The peer is the published step written down as the papers print it: numpy matrices for the guidance and the filter, one
step after the other. It flies the first steps of the same flight in the same process, so that the ratio of CPU time per
step travels between machines; how far the two are apart shows that both fly the same. Memory is the process's peak.

Then the loop alone, with no filter, no planner and no log, compiled (`eadp[fast]`) and plain: the same flight with its
battery drained. At last flight I with filter and log, compiled, beside that loop, for each second flown.
"""

from __future__ import annotations

import math
import resource
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import eadp.cli  # noqa: F401 - first: its environment is one thread for linear algebra

# isort: split
import numpy as np
from measured import options, recorded, table

from eadp.api.inputs import load_flight
from eadp.core import compiled
from eadp.simulation.loop import Outcome, fly

ROOT = Path(__file__).resolve().parent.parent
TARGET_STEPS_PER_S = 50_000
TARGET_MB, STEPS = 300, 72_471


def ours(*, fast: bool = False) -> tuple[float, int, list[tuple[float, float]]]:
    """CPU seconds of the whole flight, its steps, and the logged positions."""
    compiled.enable(fast)
    inputs = load_flight(str(ROOT / "plans/survey.plan"), scenario=str(ROOT / "scenarios/paper-I-static.yaml"))
    flight, outcome = inputs.flight(), Outcome()
    started = time.process_time()
    steps = list(fly(inputs.world, flight, outcome))
    spent = time.process_time() - started
    compiled.enable(False)
    return spent, round(outcome.duration_s / inputs.world.clock.step_s), [(step.x_m, step.y_m) for step in steps]


def alone(*, fast: bool) -> tuple[float, float]:
    """CPU seconds of a flight with the loop alone, and its duration [s]."""
    compiled.enable(fast)
    keys = {"planner.name": "static", "faults": [], "log_every_s": 1e9, "battery.capacity_ah": 100}
    inputs = load_flight(
        str(ROOT / "plans/survey.plan"), scenario=str(ROOT / "scenarios/paper-drained.yaml"), overrides=keys
    )
    flight, outcome = inputs.flight(), Outcome()
    flight.state._queue.every_s = math.inf  # no sensor is heard
    started = time.process_time()
    for _ in fly(inputs.world, flight, outcome):
        pass
    spent = time.process_time() - started
    compiled.enable(False)
    assert outcome.completed
    return spent, outcome.duration_s


def transcribed(count: int) -> tuple[float, list[tuple[float, float]]]:
    """CPU seconds and positions (every tenth) of the published step with matrices; constants of flight I."""
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    wind, dt = np.array([5.0, 0.0]), 0.01
    p, theta = np.array([-100.0, 220.0]), math.radians(270)
    velocity = 15 * np.array([math.cos(theta), math.sin(theta)]) + wind
    height, climb = 20.0, 0.0
    shift = np.zeros(2)
    stage, period, clock_from = 0, 1.0, 0.0
    state, ones = np.ones(7), np.ones((7, 7))
    row = np.array([1.0, 1, 0, 1, 0, 1, 0])
    positions = []
    started = time.process_time()
    for k in range(count):
        stages = [
            (np.array([-45.0, 146.0]), 70.0, 1, (-115.0, 146.0)),
            (-115.0, None, -1, (-115.0, -11.0)),
            (np.array([-40.0, 11.0]), 75.0, 1, (35.0, -11.0)),
            (35.0, None, 1, (35.0, 146.0)),
        ]
        where, radius, sense, trigger = stages[stage]
        local = p - shift
        if radius is None:
            gain, phi, gradient, hessian = 0.1, local[0] - where, np.array([1.0, 0.0]), np.zeros((2, 2))
        else:
            gain, offset = 0.006, local - where
            phi, gradient, hessian = offset @ offset - radius**2, 2 * offset, 2 * np.eye(2)
        rotation = sense * turn
        desired = rotation @ gradient - gain * phi * gradient
        change = (rotation - gain * phi * np.eye(2)) @ hessian @ velocity - gain * (gradient @ velocity) * gradient
        size = np.linalg.norm(desired)
        hat = -turn @ np.outer(desired, desired) @ turn @ change / size**3
        across = velocity @ turn @ desired / (np.linalg.norm(velocity) * size)
        rate = hat @ turn @ desired / size + 0.001 * across
        throttle = 5 * (25 - height) - 5 * climb
        speed = 0.3 * (50 + throttle)
        ahead = np.array([math.cos(theta), math.sin(theta)])
        climb += (9.8 / 225 * (speed + wind @ ahead) ** 2 - 9.8) * dt
        height += climb * dt
        velocity = speed * ahead + wind
        p = p + velocity * dt
        theta = math.remainder(theta + rate * dt, 2 * math.pi)
        power = 20 * (50 + throttle) / 100 + 16
        now = (k + 1) * dt
        period = max(period, now - clock_from)
        transition = np.eye(7)
        for j in (1, 2, 3):
            transition[2 * j - 1, 2 * j] = 2 * math.pi / period * j * dt
            transition[2 * j, 2 * j - 1] = -2 * math.pi / period * j * dt
        state = transition @ state
        predicted = transition @ ones @ transition.T + ones
        weight = predicted @ row / (row @ predicted @ row + 1)
        state = state + weight * (power - row @ state)
        if (k + 1) % 10 == 0:
            positions.append((float(p[0]), float(p[1])))
        if abs(p[0] - shift[0] - trigger[0]) <= 20 and abs(p[1] - shift[1] - trigger[1]) <= 20:
            stage = (stage + 1) % 4
            if stage == 0:
                shift = shift + np.array([10.0, 1.0])
                period, clock_from = now - clock_from, now
    return time.process_time() - started, positions


def main() -> None:
    """Print the figures of median runs."""
    parser = options(__doc__, "flight")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--peer-steps", type=int, default=5000)
    asked = parser.parse_args()
    with recorded("flight", write=asked.write):
        title = f"flight I, {STEPS} steps with filter and log, median of {asked.runs} runs"
        table((title, "value", "aim"), measures(asked.runs, asked.peer_steps))


def measures(runs: int, peer_steps: int) -> Iterator[list[str]]:
    """The rows of the table."""
    mine, peer, gap = [], [], 0.0
    for _ in range(runs):  # in turn, so that a noisy machine is noisy for both
        spent, steps, track = ours()
        assert steps == STEPS
        mine.append(spent / steps)
        theirs, positions = transcribed(peer_steps)
        peer.append(theirs / peer_steps)
        gap = max(gap, max(math.dist(a, b) for a, b in zip(track, positions, strict=False)))
    per_step, per_peer_step = statistics.median(mine), statistics.median(peer)
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    yield ["eadp", f"{1 / per_step:,.0f} steps per CPU s", f"{TARGET_STEPS_PER_S:,}"]
    yield ["transcription", f"{1 / per_peer_step:,.0f} steps per CPU s", ""]
    yield ["ratio", f"{per_peer_step / per_step:.1f}", ""]
    yield [f"apart, over the first {peer_steps} steps", f"{gap:.2g} m at most", ""]
    yield ["memory", f"{memory_mb:.0f} MB at most", f"{TARGET_MB} MB"]
    bare: dict[bool, float] = {}
    for fast in (True, False) if compiled.available() else (False,):
        alone(fast=fast)  # compiled
        times, lasted = zip(*(alone(fast=fast) for _ in range(runs)), strict=True)
        spent = bare[fast] = statistics.median(times)
        yield [f"the loop alone, {'compiled' if fast else 'plain'}", cost(spent, lasted[0] / 0.01), ""]
    if compiled.available():
        ours(fast=True)  # compiled
        spent = statistics.median(ours(fast=True)[0] for _ in range(runs))
        yield ["flight I with filter and log, compiled", cost(spent, STEPS), ""]
        yield ["by the loop's", f"{spent / bare[True]:.1f}", "10"]


def cost(spent_s: float, steps: float) -> str:
    """CPU time of a flight and of one of its steps."""
    return f"{1e3 * spent_s:.1f} ms for {steps * 0.01:.0f} s, {1e9 * spent_s / steps:.0f} ns a step"


if __name__ == "__main__":
    main()
