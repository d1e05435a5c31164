"""An electric aeroplane of 2 kg that knows nothing of eadp's models: what benchmarks/twin.py flies.

- Airframe: six degrees of freedom in JSBSim, `twin/wing/wing.xml`, a propeller's tables, an attitude controller.
- Autopilot: airspeed by the throttle, altitude by the pitch, and a bank from cross-track error, course error and
  curvature of the path. Of eadp it uses a plan's stages alone: their paths, and which one is flown at which parameters.
- Air: a steady wind, and gusts of the Dryden spectra of MIL-F-8785C for low altitudes.
- Battery: lithium polymer cells, an open-circuit voltage by cell that is not linear in the charge, a resistance, an
  under-voltage cut-off, and a gauge that integrates the current and shows steps of 1 %.

Needs jsbsim: pip install 'eadp[bench]'.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import signal

os.environ.setdefault("JSBSIM_DEBUG", "0")
try:
    import jsbsim
except ImportError:
    sys.exit("this benchmark flies in JSBSim, which is not installed: pip install 'eadp[bench]'")

from eadp.models.plan.cursor import PlanCursor, Rules
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.plan import Plan

HERE = Path(__file__).resolve().parent
STEP_S, CONTROL_S, SAMPLE_S = 0.01, 0.05, 0.2
SETTLE_S, ALTITUDE_M, AIRSPEED_MPS, MASS_KG = 30.0, 100.0, 15.0, 2.0
FOOT_M, HORSEPOWER_W, GRAVITY_MPS2 = 0.3048, 745.69987, 9.80665
MOTOR_EFFICIENCY, ESC_EFFICIENCY, AVIONICS_W, MAX_SHAFT_W = 0.80, 0.95, 4.0, 250.0
MAX_BANK_RAD = math.radians(50)


# --- air


class Dryden:
    """Gusts along and across the heading and downwards [m/s], every CONTROL_S: filtered white noise.

    The filters are those of MIL-F-8785C below 1,000 ft, at the cruise airspeed and altitude, so that the series depends
    on its seed alone: every flight of a mission meets the same gusts at the same times.
    """

    def __init__(self, wind_mps: float, seed: int, duration_s: float) -> None:
        rng = np.random.default_rng(seed)
        height_ft = ALTITUDE_M / FOOT_M
        factor = 0.177 + 0.000823 * height_ft
        # wind at 20 ft by the power law of flat country; thermals move the air on a day without wind, too
        vertical_mps = 0.1 * max(wind_mps * (20 / height_ft) ** 0.143, 1.0)
        horizontal_mps = vertical_mps / factor**0.4
        along_m, down_m = height_ft / factor**1.2 * FOOT_M, ALTITUDE_M
        self.stds_mps, self.lengths_m = (horizontal_mps, horizontal_mps, vertical_mps), (along_m, along_m, down_m)
        count = int(duration_s / CONTROL_S)
        series = []
        for axis, (std, length) in enumerate(zip(self.stds_mps, self.lengths_m, strict=True)):
            tau = length / AIRSPEED_MPS
            if axis == 0:
                # σ √(2τ) / (1 + τ s)
                zeros, poles = [std * math.sqrt(2 * tau)], [tau, 1]
            else:
                # σ √τ (1 + √3 τ s) / (1 + τ s)²
                zeros, poles = [std * math.sqrt(3 * tau) * tau, std * math.sqrt(tau)], [tau * tau, 2 * tau, 1]
            b, a, _ = signal.cont2discrete((zeros, poles), CONTROL_S, "bilinear")
            white = rng.standard_normal(count + 4000) / math.sqrt(CONTROL_S)
            series.append(signal.lfilter(np.ravel(b), a, white)[4000:])
        self.series_mps = np.array(series)

    def spectrum(self, axis: int, frequency_hz: np.ndarray) -> np.ndarray:
        """Power spectral density of the standard, one-sided [m²/s² per Hz]."""
        std, x = self.stds_mps[axis], self.lengths_m[axis] / AIRSPEED_MPS * 2 * np.pi * frequency_hz
        density = std**2 * self.lengths_m[axis] / AIRSPEED_MPS
        return 4 * density / (1 + x**2) if axis == 0 else 2 * density * (1 + 3 * x**2) / (1 + x**2) ** 2


# --- battery


CELL_SOC = (0.0, 0.02, 0.05, 0.10, 0.20, 0.30, 0.40, 0.50, 0.60, 0.70, 0.80, 0.90, 1.0)
CELL_V = (3.10, 3.35, 3.55, 3.67, 3.72, 3.76, 3.79, 3.83, 3.88, 3.95, 4.02, 4.10, 4.19)
CUTOFF_CELL_V, CUTOFF_S = 3.2, 2.0


@dataclass
class Lipo:
    """A pack in use; `soc` may be an array, of several packs at once."""

    capacity_ah: float
    resistance_ohm: float
    cells: int = 4

    soc: float | np.ndarray = 1.0
    empty: bool | np.ndarray = False
    consumed_ah: float | np.ndarray = 0.0
    voltage_v: float | np.ndarray = 0.0
    current_a: float | np.ndarray = 0.0
    low_s: float | np.ndarray = 0.0
    """Since when the voltage has been below the cut-off."""

    @property
    def open_v(self) -> float | np.ndarray:
        """Open-circuit voltage."""
        return self.cells * np.interp(self.soc, CELL_SOC, CELL_V)

    def step(self, power_w: float | np.ndarray, seconds: float, loss: float = 0.0) -> None:
        """Deliver a power, after a `loss` of charge. Below the cut-off for CUTOFF_S, the pack is empty for good."""
        self.soc = self.soc - loss
        open_v = self.open_v
        # I = (V − √(V² − 4 R P)) / 2R
        root = np.sqrt(np.maximum(open_v**2 - 4 * self.resistance_ohm * power_w, 0.0))
        self.current_a = (open_v - root) / (2 * self.resistance_ohm)
        self.voltage_v = open_v - self.resistance_ohm * self.current_a
        self.consumed_ah = self.consumed_ah + self.current_a * seconds / 3600
        self.soc = self.soc - self.current_a * seconds / 3600 / self.capacity_ah
        self.low_s = (self.low_s + seconds) * (self.voltage_v < CUTOFF_CELL_V * self.cells)
        self.empty = self.empty | (self.low_s >= CUTOFF_S) | (self.soc <= 0)


# --- airframe


class Aeroplane:
    """The airframe in JSBSim: trimmed at a point and course, and flown by bank, altitude and airspeed."""

    def __init__(
        self,
        start_m: tuple[float, float],
        course_rad: float,
        wind_mps: tuple[float, float],
        gusts: Dryden | None = None,
        altitude_m: float = ALTITUDE_M,
    ) -> None:
        self._fdm = fdm = jsbsim.FGFDMExec(str(HERE), None)
        fdm.set_debug_level(0)
        fdm.set_aircraft_path(str(HERE / "twin"))
        fdm.disable_output()
        if not fdm.load_model("wing"):
            raise SystemExit("JSBSim does not load twin/wing/wing.xml")
        fdm.set_dt(STEP_S)
        air = AIRSPEED_MPS * math.cos(course_rad), AIRSPEED_MPS * math.sin(course_rad)
        initial = {
            "ic/h-sl-ft": altitude_m / FOOT_M,
            "ic/lat-geod-deg": 55.4,
            "ic/long-gc-deg": 10.3,
            "ic/psi-true-deg": math.degrees(math.pi / 2 - course_rad) % 360,
            "ic/ve-fps": (air[0] + wind_mps[0]) / FOOT_M,
            "ic/vn-fps": (air[1] + wind_mps[1]) / FOOT_M,
        }
        for name, value in initial.items():
            fdm[name] = value
        fdm.run_ic()
        fdm["atmosphere/wind-east-fps"], fdm["atmosphere/wind-north-fps"] = wind_mps[0] / FOOT_M, wind_mps[1] / FOOT_M
        fdm["propulsion/set-running"] = -1
        self._gusts, self._step = gusts, 0
        self._speed_integral, self._climb_integral, self._origin = 0.2, 0.0, (0.0, 0.0, 0.0, 0.0)
        self.altitude_target_m, self.airspeed_target_mps = altitude_m, AIRSPEED_MPS
        # the propeller comes up to its speed; then the clock starts, at the start
        while self._step * CONTROL_S < SETTLE_S:
            self._read()
            self.control(_turn_rad(self, _wrapped(course_rad - self.course_rad)))
        self._step = 0
        latitude, longitude = fdm["position/lat-geod-rad"], fdm["position/long-gc-rad"]
        self._origin = (latitude, longitude, *start_m)
        self._read()

    def control(self, bank_rad: float) -> None:
        """Fly CONTROL_S with a bank asked for, to the right."""
        fdm = self._fdm
        if self._gusts is not None:
            u, v, w = self._gusts.series_mps[:, self._step % self._gusts.series_mps.shape[1]]
            sine, cosine = math.sin(self.heading_rad), math.cos(self.heading_rad)
            fdm["atmosphere/gust-east-fps"] = (u * cosine + v * sine) / FOOT_M
            fdm["atmosphere/gust-north-fps"] = (u * sine - v * cosine) / FOOT_M
            fdm["atmosphere/gust-down-fps"] = w / FOOT_M
        climb_mps = min(max(0.4 * (self.altitude_target_m - self.altitude_m), -2.5), 2.5)
        error_mps = climb_mps - self.climb_mps
        self._climb_integral = min(max(self._climb_integral + 0.01 * error_mps * CONTROL_S, -0.2), 0.2)
        load = 1 / math.cos(self.bank_rad)
        # more lift in a turn, by more incidence
        fdm["ap/pitch-cmd-rad"] = (
            climb_mps / AIRSPEED_MPS + self._climb_integral + 0.02 * error_mps + 0.065 * (load - 1)
        )
        fdm["ap/bank-cmd-rad"] = min(max(bank_rad, -MAX_BANK_RAD), MAX_BANK_RAD)
        slow_mps = self.airspeed_target_mps - self.airspeed_mps
        self._speed_integral = min(max(self._speed_integral + 0.015 * slow_mps * CONTROL_S, 0.0), 0.8)
        climbing = MASS_KG * GRAVITY_MPS2 * climb_mps / 0.7 / MAX_SHAFT_W
        throttle = self._speed_integral + 0.05 * slow_mps + climbing + 0.04 * (load * load - 1)
        fdm["fcs/throttle-cmd-norm"] = min(max(throttle, 0.0), 1.0)
        for _ in range(round(CONTROL_S / STEP_S)):
            fdm.run()
        self._step += 1
        self._read()

    def _read(self) -> None:
        fdm = self._fdm
        latitude, longitude, x0, y0 = self._origin
        self.time_s = self._step * CONTROL_S
        # radii of curvature of WGS-84: a local plane is exact to a centimetre in a kilometre
        sine2 = math.sin(latitude) ** 2
        across_m = 6378137.0 / math.sqrt(1 - 0.00669438 * sine2)
        along_m = across_m * (1 - 0.00669438) / (1 - 0.00669438 * sine2)
        self.x_m = x0 + (fdm["position/long-gc-rad"] - longitude) * across_m * math.cos(latitude)
        self.y_m = y0 + (fdm["position/lat-geod-rad"] - latitude) * along_m
        self.altitude_m = fdm["position/h-sl-ft"] * FOOT_M
        self.airspeed_mps = fdm["velocities/vt-fps"] * FOOT_M
        self.east_mps, self.north_mps = fdm["velocities/v-east-fps"] * FOOT_M, fdm["velocities/v-north-fps"] * FOOT_M
        self.climb_mps = fdm["velocities/h-dot-fps"] * FOOT_M
        self.bank_rad = fdm["attitude/phi-rad"]
        self.heading_rad = math.pi / 2 - fdm["attitude/psi-rad"]
        self.course_rad = math.atan2(self.north_mps, self.east_mps)
        self.shaft_w = fdm["propulsion/engine/power-hp"] * HORSEPOWER_W


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2 * math.pi)


def _turn_rad(plane: Aeroplane, rate_radps: float) -> float:
    """Bank to the right that turns the course at a rate, counter-clockwise."""
    ground_mps = math.hypot(plane.east_mps, plane.north_mps)
    crab = max(math.cos(plane.heading_rad - plane.course_rad), 0.3)
    # g tan φ cos(θ − χ) = χ̇ |v|
    return -math.atan(ground_mps * rate_radps / (GRAVITY_MPS2 * crab))


# --- a flight of a plan


class Sample(NamedTuple):
    """The aeroplane at the end of SAMPLE_S; the shaft's power is the mean over it."""

    time_s: float
    x_m: float
    y_m: float
    altitude_m: float
    airspeed_mps: float
    east_mps: float
    north_mps: float
    heading_deg: float
    bank_deg: float
    climb_mps: float
    shaft_w: float
    stage: int
    parameters: tuple[float, ...]
    shares: tuple[float | None, ...]


def sampled(
    plane: Aeroplane,
    shaft_w: float,
    stage: int = 0,
    parameters: tuple[float, ...] = (0.0, 0.0),
    shares: tuple[float | None, ...] = (),
) -> Sample:
    """What the aeroplane does now."""
    position, ground = (plane.x_m, plane.y_m, plane.altitude_m), (plane.east_mps, plane.north_mps)
    heading, bank = math.degrees(math.pi / 2 - plane.heading_rad) % 360, math.degrees(plane.bank_rad)
    motion = (plane.time_s, *position, plane.airspeed_mps, *ground, heading, bank, plane.climb_mps, shaft_w)
    return Sample(*motion, stage, parameters, shares)


class PlanFlight:
    """The aeroplane on a plan: `samples` flies it, `decide` gives other parameters on the way."""

    def __init__(
        self,
        plan: Plan,
        parameters: Sequence[float],
        start_m: tuple[float, float],
        wind_mps: tuple[float, float],
        gusts: Dryden | None = None,
    ) -> None:
        self.executor = PlanExecutor(PlanCursor.start(plan, parameters, Rules()), start_m)
        self.plane = Aeroplane(start_m, self._course(*start_m)[0], wind_mps, gusts)
        commanded = [stage.altitude_m for stage in plan.stages if stage.altitude_m is not None]
        # it starts at the first altitude that the plan commands
        self.home_m = ALTITUDE_M - (commanded[0] if commanded else ALTITUDE_M)

    def decide(self, parameters: Sequence[float]) -> None:
        """Take other parameters: the plan's rules put them in force."""
        self.executor.decide(parameters, (self.plane.x_m, self.plane.y_m))

    def samples(self, limit_s: float = 7200.0) -> Iterator[Sample]:
        """Fly to the end of the plan, a sample every SAMPLE_S."""
        plane, executor = self.plane, self.executor
        while not executor.complete and plane.time_s < limit_s:
            shaft_w, count = 0.0, round(SAMPLE_S / CONTROL_S)
            if executor.stage.altitude_m is not None:
                plane.altitude_target_m = self.home_m + executor.stage.altitude_m
            for _ in range(count):
                plane.control(self._bank())
                shaft_w += plane.shaft_w / count
                executor.advance(plane.x_m, plane.y_m)
            values = executor.parameters
            shares = [box.share(value) for box, value in zip(executor.stage.sets, values, strict=True)]
            yield sampled(plane, shaft_w, executor.stage.index, values, tuple(shares))

    def right_m(self) -> float:
        """How far right of its path the aeroplane is."""
        return self._course(self.plane.x_m, self.plane.y_m)[2]

    def _course(self, x: float, y: float) -> tuple[float, float, float]:
        """Direction of the path at a position [rad], its curvature to the left [1/m], the distance to its right [m]."""
        cursor = self.executor.cursor
        value, gx, gy, hxx, hxy, hyy = self.executor.path(x - cursor.offset_m[0], y - cursor.offset_m[1])
        sense, steep = cursor.stage.sense, max(math.hypot(gx, gy), 1e-9)
        tx, ty = -sense * gy / steep, sense * gx / steep
        # of the level line through the position: κ = tᵀHt / |∇φ|
        curvature = sense * (tx * tx * hxx + 2 * tx * ty * hxy + ty * ty * hyy) / steep
        return math.atan2(ty, tx), curvature, sense * value / steep

    def _bank(self) -> float:
        """Bank that brings the course to the path, and along it."""
        plane = self.plane
        direction, curvature, right_m = self._course(plane.x_m, plane.y_m)
        ground_mps = math.hypot(plane.east_mps, plane.north_mps)
        off = _wrapped(direction + math.atan(right_m / (1.6 * ground_mps)) - plane.course_rad)
        along = curvature * ground_mps * math.cos(plane.course_rad - direction)
        return _turn_rad(plane, along + 1.1 * off)


def battery_w(shaft_w: float | np.ndarray) -> float | np.ndarray:
    """Power of motor, speed controller and avionics at the battery."""
    return shaft_w / (MOTOR_EFFICIENCY * ESC_EFFICIENCY) + AVIONICS_W
