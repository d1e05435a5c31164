"""One re-planning solve beside lean programs of the same relaxed problem in CasADi: by fatrop, DAQP, OSQP and IPOPT.

usage: python benchmarks/replan.py [--instances 200] [--seed 0] [--plain]

The letter's computation (4.75376 to 9.75462 W on levels 2 to 10) and battery, a motion power of three harmonics and a
period of 46 s, steps of 1 s. Ours is all that the planner `paper` does when it re-plans: the forecast from the Fourier
state, the QP by OSQP, the levels to fly with, their verification and their bound. No solution is kept: OSQP runs every
time. The peers solve for real parameters alone. IPOPT and fatrop by multiple shooting, with seven energy coefficients
and the state of charge as states, the exact rotation of one second as dynamics, built once with the measured state as
parameter, expanded, started from the last answer and multipliers; for fatrop, which takes no multipliers, the charge
alone is a state. DAQP and OSQP by two quadratic programs, condensed by CasADi.

Compiled (`eadp[fast]`), unless `--plain` or numba is not installed.

Prints medians of the CPU time over the same instances, on one thread of one process, once in blocks of 25 (ours, then
each peer's), and once in turn, where each finds the processor's caches filled by the others. Over as many unrelated
instances it prints how our levels compare with the best of the peer's answers from several starts, rounded down to
levels; our largest gap to the bound; and our worst violation in an independent model. Needs casadi: pip install
'eadp[bench]'.
"""

from __future__ import annotations

import itertools
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"  # threads of the linear algebra only wait for each other in problems of ten

import numpy as np
from measured import options, recorded, table

from eadp.core import compiled
from eadp.core.signals import output_row
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.measure.harmonics import design_matrix
from eadp.models.battery import Battery
from eadp.models.computing import join_profile
from eadp.models.plan.cursor import PlanCursor
from eadp.models.profile import Profile
from eadp.models.vehicle import PaperVehicle
from eadp.models.world import Mission
from eadp.papers import horizon
from eadp.papers.estimator import EstimatorSettings, ExactEstimator
from eadp.papers.forecasting import rotation_matrix
from eadp.papers.horizon import HorizonForecast, HorizonSolution
from eadp.papers.planner import PaperPlanner, PaperSettings
from eadp.planning.base import Observation, PlannerSettings, Sample

try:
    import casadi
except ImportError:
    sys.exit("this benchmark compares with CasADi, which is not installed: pip install 'eadp[bench]'")

ROOT = Path(__file__).resolve().parent.parent
BATTERY = Battery(14.8, 0.0012, 3.2, 0.00183, 1.0, 1.0)
LOW, HIGH, LOW_W, HIGH_W = 2.0, 10.0, 4.75376, 9.75462
SLOPE_W = (HIGH_W - LOW_W) / (HIGH - LOW)
PERIOD_S, ORDER, SAMPLES = 46.0, 3, 10
SOC_PER_A = BATTERY.k_b_per_s / BATTERY.capacity_ah
STARTS = (0.0, 0.5, 1.0)
BLOCK = 25


@dataclass(frozen=True)
class Instance:
    """A measured state [W] and state of charge."""

    state_w: np.ndarray
    soc: float


# --- instances


def instances(rng: np.random.Generator, count: int, steps: int, related: bool) -> list[Instance]:
    """Instances whose output constraint is active for some choice of computations, and met by the lowest.

    Related ones follow each other by a second, with noise; others have nothing in common.
    """
    found: list[Instance] = []
    turn = rotation_matrix(ORDER, PERIOD_S, 1.0)
    state, spare_w = any_state(rng), 3.0
    for _ in range(count):
        if related:
            state = turn @ state + rng.normal(0.0, 0.05, len(state))
            spare_w = float(np.clip(spare_w + rng.normal(0.0, 0.3), 0.5, 6.0))
        else:
            state, spare_w = any_state(rng), rng.uniform(0.2, 6.0)
        found.append(Instance(state, min_soc(state, steps) + spare_w / BATTERY.power_per_soc_w))
    return found


def any_state(rng: np.random.Generator) -> np.ndarray:
    """A state of 26 W in the mean and of about 2 W in each harmonic."""
    return np.concatenate([[26.0 + rng.normal()], rng.normal(0.0, 1.5, 2 * ORDER)])


def min_soc(state_w: np.ndarray, steps: int) -> float:
    """The state of charge that the lowest computations need over a horizon."""
    ahead_s = np.arange(1, steps * SAMPLES + 1) / SAMPLES
    motion = (design_matrix(ahead_s, 1 / PERIOD_S, ORDER) @ state_w).reshape(steps, SAMPLES)
    drops = SOC_PER_A * np.cumsum([current_a(power) for power in motion.mean(axis=1) + LOW_W])
    return float(np.max((motion.max(axis=1) + LOW_W) / BATTERY.power_per_soc_w + drops))


def current_a(power_w: float) -> float:
    """Current [A] of a power [W] from the battery's quadratic, R I² − V I + y = 0, independently of `eadp`."""
    return float(np.roots([BATTERY.resistance_ohm, -BATTERY.voltage_v, power_w]).real.min())


# --- ours


class Ours:
    """The planner `paper`, from a measured state to an answer."""

    def __init__(self, steps: int) -> None:
        plan, _ = read_plan(read_text(str(ROOT / "plans/survey.plan")))
        profile = Profile(("fps",), ("",), np.array([[LOW], [HIGH]]), np.array([LOW_W, HIGH_W]))
        mission = Mission(plan, join_profile(plan, profile), BATTERY, PaperVehicle(), (0.0, HIGH), (-100.0, 220.0))
        settings = PaperSettings(horizon_s=float(steps), constraint_at="end")
        self._planner = PaperPlanner(PlannerSettings(), mission, settings)
        cursor = PlanCursor.start(plan, mission.parameters)
        self._observation = Observation(Sample(0.0, (0.0, 0.0), None, 1.0), 1.0, cursor, (-100.0, 220.0), 1)
        self._horizon = self._planner._horizon(self._observation, (0.0,))
        horizon.OPTIMAL = -np.inf  # nothing is kept
        self._steps = steps

    def prepare(self, instance: Instance) -> Observation:
        """Make the planner's estimate that of an instance."""
        self._planner.power._estimator = ExactEstimator(EstimatorSettings(), PERIOD_S, instance.state_w)
        return self._observation._replace(soc=instance.soc)

    def solve(self, observation: Observation) -> tuple[HorizonForecast, HorizonSolution]:
        """Re-plan: what is timed."""
        forecast = self._planner._horizon_forecast(observation)
        return forecast, self._horizon.solve(forecast)


# --- the peer


class Peer:
    """Multiple shooting over c (1), q (7) and b (1) of each step; see the module."""

    def __init__(self, steps: int) -> None:
        self._steps, self._size = steps, 2 * ORDER + 2
        self._turn = rotation_matrix(ORDER, PERIOD_S, 1.0)
        instants = (np.arange(SAMPLES) + 1) / SAMPLES
        output = output_row(ORDER)
        # what the mean over a step reads off the state at its start
        self._mean = np.mean([output @ rotation_matrix(ORDER, PERIOD_S, t) for t in instants], axis=0)
        measured, c = casadi.MX.sym("measured", self._size), casadi.MX.sym("c", steps)
        states = casadi.MX.sym("states", self._size, steps)
        at, dynamics, limits, cost = measured, [], [], 0
        for m in range(steps):
            power = LOW_W + SLOPE_W * (c[m] - LOW)
            total = casadi.dot(self._mean, at[:-1]) + power
            root = casadi.sqrt(BATTERY.voltage_v**2 - 4 * BATTERY.resistance_ohm * total)
            current = 2 * total / (BATTERY.voltage_v + root)
            after = casadi.vertcat(casadi.mtimes(self._turn, at[:-1]), at[-1] - SOC_PER_A * current)
            dynamics.append(states[:, m] - after)
            at = states[:, m]
            limits.append(BATTERY.power_per_soc_w * at[-1] - casadi.dot(output, at[:-1]) - power)
            cost -= power**2
        problem = {
            "x": casadi.vertcat(c, casadi.vec(states)),
            "p": measured,
            "f": cost / (steps * HIGH_W**2),
            "g": casadi.vertcat(*dynamics, *limits),
        }
        self._solver = casadi.nlpsol("replan", "ipopt", problem, OPTIONS)
        count = self._size * steps
        self._bounds = {
            "lbx": np.r_[np.full(steps, LOW), np.full(count, -np.inf)],
            "ubx": np.r_[np.full(steps, HIGH), np.full(count, np.inf)],
            "lbg": np.zeros(count + steps),
            "ubg": np.r_[np.zeros(count), np.full(steps, np.inf)],
        }

    def start(self, instance: Instance, c: np.ndarray, last: Any = None) -> dict[str, Any]:
        """Where to begin: computations, the states they lead to, and the multipliers of the last answer."""
        state, soc, states = instance.state_w, instance.soc, []
        for m in range(self._steps):
            soc -= SOC_PER_A * current_a(self._mean @ state + LOW_W + SLOPE_W * (c[m] - LOW))
            state = self._turn @ state
            states.append(np.r_[state, soc])
        begin: dict[str, Any] = {"x0": np.r_[c, np.concatenate(states)], "p": np.r_[instance.state_w, instance.soc]}
        if last is not None:
            begin |= {"lam_x0": last["lam_x"], "lam_g0": last["lam_g"]}
        return begin

    def solve(self, start: dict[str, Any]) -> Any:
        """Solve: what is timed."""
        return self._solver(**start, **self._bounds)

    def reals(self, answer: Any) -> np.ndarray:
        """The computations of an answer."""
        return np.clip(np.array(answer["x"]).ravel()[: self._steps], LOW, HIGH)

    def solved(self) -> bool:
        """Whether the last answer is one."""
        return bool(self._solver.stats()["success"])


class StagedPeer(Peer):
    """The same problem as a chain of stages by fatrop; the charge alone is a state, the motion's power a parameter."""

    def __init__(self, steps: int) -> None:
        super().__init__(steps)
        turns = [np.linalg.matrix_power(self._turn, m) for m in range(steps + 1)]
        self._motion = np.vstack(
            [self._mean @ turn for turn in turns[:-1]] + [output_row(ORDER) @ t for t in turns[1:]]
        )
        given, b, c = (casadi.SX.sym("_", size) for size in (2 * steps + 1, steps + 1, steps))
        rows, cost = [], 0
        for m in range(steps):
            power = LOW_W + SLOPE_W * (c[m] - LOW)
            total = given[m] + power
            root = casadi.sqrt(BATTERY.voltage_v**2 - 4 * BATTERY.resistance_ohm * total)
            after = b[m] - SOC_PER_A * 2 * total / (BATTERY.voltage_v + root)
            rows += [b[m + 1] - after, *([b[0] - given[-1]] if m == 0 else [])]
            rows.append(BATTERY.power_per_soc_w * after - given[steps + m] - power)
            cost -= power**2
        pairs = [each for m in range(steps) for each in (b[m], c[m])]
        equal = [True, True, False] + [True, False] * (steps - 1)
        problem = {
            "x": casadi.vertcat(*pairs, b[steps]),
            "p": given,
            "f": cost / (steps * HIGH_W**2),
            "g": casadi.vertcat(*rows),
        }
        self._solver = casadi.nlpsol("replan", "fatrop", problem, STAGED_OPTIONS | {"equality": equal})
        self._bounds = {
            "lbx": np.r_[np.tile([-np.inf, LOW], steps), -np.inf],
            "ubx": np.r_[np.tile([np.inf, HIGH], steps), np.inf],
            "lbg": np.zeros(len(equal)),
            "ubg": np.where(equal, 0.0, np.inf),
        }

    def start(self, instance: Instance, c: np.ndarray, last: Any = None) -> dict[str, Any]:
        """Where to begin: computations, and the charges they lead to."""
        charges = super().start(instance, c)["x0"][self._steps :][self._size - 1 :: self._size]
        begin = np.r_[np.stack([np.r_[instance.soc, charges[:-1]], c], axis=1).ravel(), charges[-1]]
        return {"x0": begin, "measured": instance}

    def solve(self, start: dict[str, Any]) -> Any:
        """Solve: what is timed."""
        measured = start["measured"]
        given = np.r_[self._motion @ measured.state_w, measured.soc]
        return self._solver(x0=start["x0"], p=given, **self._bounds)

    def reals(self, answer: Any) -> np.ndarray:
        """The computations of an answer."""
        return np.clip(np.array(answer["x"]).ravel()[1::2], LOW, HIGH)


class QpPeer(Peer):
    """The same problem in the computations alone, as two quadratic programs, by CasADi with a plug-in.

    The states follow from the computations (condensed); objective and limits are linearised about the last answer.
    """

    plug_in = "osqp"

    def __init__(self, steps: int) -> None:
        super().__init__(steps)
        measured, c = casadi.SX.sym("measured", self._size), casadi.SX.sym("c", steps)
        state, soc, limits, gain = measured[:-1], measured[-1], [], 0
        output = casadi.DM(output_row(ORDER)).T
        for m in range(steps):
            power = LOW_W + SLOPE_W * (c[m] - LOW)
            total = casadi.dot(casadi.DM(self._mean), state) + power
            root = casadi.sqrt(BATTERY.voltage_v**2 - 4 * BATTERY.resistance_ohm * total)
            soc -= SOC_PER_A * 2 * total / (BATTERY.voltage_v + root)
            state = casadi.mtimes(casadi.DM(self._turn), state)
            limits.append(BATTERY.power_per_soc_w * soc - casadi.mtimes(output, state) - power)
            gain += power**2
        limit = casadi.vertcat(*limits)
        slope = casadi.gradient(gain, c)
        parts = [-slope / casadi.norm_inf(slope), casadi.jacobian(limit, c), limit]
        self._linear = casadi.Function("linear", [c, measured], parts)
        self._hessian = casadi.DM.eye(steps) * PROXIMAL
        structure = {"h": self._hessian.sparsity(), "a": self._linear.sparsity_out(1)}
        self._qp = casadi.conic("replan", self.plug_in, structure, QP_OPTIONS[self.plug_in])

    def solve(self, start: dict[str, Any]) -> Any:
        """Solve: what is timed."""
        c, last = start["x0"], start["multipliers"]
        for _ in range(2):
            gradient, rows, limit = self._linear(c, start["p"])
            found = self._qp(h=self._hessian, g=gradient, a=rows, lba=-limit, lbx=LOW - c, ubx=HIGH - c, **last)
            c = np.clip(c + np.array(found["x"]).ravel(), LOW, HIGH)
            last = {"lam_x0": found["lam_x"], "lam_a0": found["lam_a"]}
        return {"x": c, "multipliers": last}

    def start(self, instance: Instance, c: np.ndarray, last: Any = None) -> dict[str, Any]:
        """Where to begin: computations and multipliers of the last answer, and the measured state."""
        multipliers = {} if last is None else last["multipliers"]
        return {"x0": c, "p": np.r_[instance.state_w, instance.soc], "multipliers": multipliers}

    def solved(self) -> bool:
        """Whether the last answer is one."""
        return bool(self._qp.stats()["success"])


class DaqpPeer(QpPeer):
    """By DAQP."""

    plug_in = "daqp"


PEERS: dict[str, type[Peer]] = {"fatrop": StagedPeer, "DAQP": DaqpPeer, "OSQP as plug-in": QpPeer, "IPOPT": Peer}
PROXIMAL = horizon.PROXIMAL / (HIGH - LOW) ** 2  # as ours, where computations are shares of their range
SILENT = {"print_time": False, "error_on_fail": False}
QP_OPTIONS = {
    "osqp": {
        "warm_start_primal": True,
        "warm_start_dual": True,
        "osqp": {"verbose": False, "eps_abs": 1e-6, "eps_rel": 1e-6, "max_iter": 20000},
        **SILENT,
    },
    "daqp": SILENT,
}
STAGED_OPTIONS = {
    "expand": True,
    "structure_detection": "auto",
    "fatrop.print_level": 0,
    "fatrop.tol": 1e-7,
    "fatrop.mu_init": 1e-6,  # the fewest iterations of those tried: 7 (10 s) and 9 (46 s) in the median
    **SILENT,
}

# the fewest iterations of the settings tried: 5 (10 s) and 8 (46 s) in the median
OPTIONS = {
    "expand": True,
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-7,
    "ipopt.mu_strategy": "adaptive",
    "ipopt.mu_init": 1e-4,
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": 1e-6,
    "ipopt.warm_start_bound_frac": 1e-6,
    "ipopt.warm_start_slack_bound_push": 1e-6,
    "ipopt.warm_start_slack_bound_frac": 1e-6,
    "ipopt.warm_start_mult_bound_push": 1e-6,
}


# --- measures


class Speed:
    """Milliseconds of each solve of one program, and how many failed."""

    def __init__(self) -> None:
        self.ms, self.failed = list[float](), 0

    def time(self, solve: Callable[[Any], Any], given: Any) -> Any:
        """Solve, timed."""
        started = time.thread_time()
        found = solve(given)
        self.ms.append(1e3 * (time.thread_time() - started))
        return found


def speed(rng: np.random.Generator, count: int, steps: int, block: int) -> tuple[Speed, dict[str, Speed], float]:
    """All on the same related instances, a block at a time, the peers from their last answers.

    Ours, the peers' by name, and the share of instances whose limits are active.
    """
    ours, peers = Ours(steps), {name: kind(steps) for name, kind in PEERS.items()}
    own, others, active = Speed(), {name: Speed() for name in peers}, 0
    answers = {name: (np.full(steps, HIGH), None) for name in peers}
    found = instances(rng, count, steps, related=True)
    for first in range(0, count, block):
        for instance in found[first : first + block]:
            _, plan = own.time(ours.solve, ours.prepare(instance))
            active += bool(plan.chosen_w.min() < HIGH_W - 1e-6)
        for name, peer in peers.items():
            for instance in found[first : first + block]:
                last = others[name].time(peer.solve, peer.start(instance, *answers[name]))
                answers[name] = peer.reals(last), last
                others[name].failed += not peer.solved()
    return own, others, active / count


@dataclass(frozen=True)
class Quality:
    """Our levels' value less that of the peer's rounded down, as shares; our gap to the bound; our violation [W]."""

    ahead: list[float]
    gaps: list[float]
    violation_w: float


def quality(rng: np.random.Generator, count: int, steps: int) -> Quality:
    """Both on unrelated instances, the peer from several starts."""
    ours, peer = Ours(steps), Peer(steps)
    ahead, gaps, violation_w = [], [], -np.inf
    for instance in instances(rng, count, steps, related=False):
        forecast, plan = ours.solve(ours.prepare(instance))
        own = value_of(plan.chosen[:, 0])
        starts = [np.full(steps, LOW + share * (HIGH - LOW)) for share in STARTS]
        starts += [rng.uniform(LOW, HIGH, steps), plan.chosen[:, 0]]
        best = -np.inf
        for c in starts:
            levels = np.floor(peer.reals(peer.solve(peer.start(instance, c))) + 1e-4)
            if excess_w(levels, forecast) <= 1e-5:
                best = max(best, value_of(levels))
        if best > -np.inf:  # rounding down does not keep every limit of the peer's answer
            ahead.append((own - best) / own)
        gaps.append(plan.gap)
        violation_w = max(violation_w, excess_w(plan.chosen[:, 0], forecast))
    return Quality(ahead, gaps, violation_w)


def value_of(c: np.ndarray) -> float:
    """Σ of the squared control."""
    return float(np.sum((LOW_W + SLOPE_W * (c - LOW)) ** 2))


def excess_w(c: np.ndarray, forecast: HorizonForecast) -> float:
    """The most that any step's power is above its limit [W], stepped through independently of `eadp`."""
    soc, most = forecast.soc, -np.inf
    for limit, mean, power in zip(
        forecast.limit_motion_w, forecast.mean_motion_w, LOW_W + SLOPE_W * (c - LOW), strict=True
    ):
        soc -= SOC_PER_A * current_a(mean + power)
        most = max(most, limit + power - BATTERY.capacity_ah * BATTERY.voltage_v * BATTERY.letter_crate_per_h * soc)
    return float(most)


TITLES = "horizon, order, peer", "ours, all [ms]", "peer, reals [ms]", "ratio", "active", "peer failed"
LEVELS = "horizon", "ahead of the peer: least", "mean", "largest", "gap, median", "violation [W]"


def main() -> None:
    parser = options(__doc__, "replan")
    parser.add_argument("--instances", type=int, default=200, help="how many of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of the instances")
    parser.add_argument("--plain", action="store_true", help="without compiled code")
    asked = parser.parse_args()
    fast = compiled.enable(not asked.plain)
    with recorded("replan", write=asked.write):
        print(f"{asked.instances} instances of each kind, seed {asked.seed}, {'compiled' if fast else 'plain'}")
        table(TITLES, speeds(asked.instances, asked.seed))
        table(LEVELS, (levels(asked.instances, asked.seed + 1, steps) for steps in (10, round(PERIOD_S))))


def speeds(count: int, seed: int) -> Iterator[list[str]]:
    """The rows of speeds."""
    for steps, block in itertools.product((10, round(PERIOD_S)), (BLOCK, 1)):
        own, others, active = speed(np.random.default_rng(seed), count, steps, block)
        ours = float(np.median(own.ms))
        order = "in turn" if block == 1 else "in blocks"
        for name, other in others.items():
            peer = float(np.median(other.ms))
            cells = f"{ours:.3f}", f"{peer:.3f}", f"{peer / ours:.2f}", f"{active:.0%}", f"{other.failed / count:.1%}"
            yield [f"{steps} s, {order}, {name}", *cells]


def levels(count: int, seed: int, steps: int) -> list[str]:
    """A row of how good the levels are."""
    q = quality(np.random.default_rng(seed), count, steps)
    figures = min(q.ahead), np.mean(q.ahead), max(q.ahead), np.median(q.gaps), q.violation_w
    return [f"{steps} s", *(f"{figure:.1e}" for figure in figures)]


if __name__ == "__main__":
    main()
