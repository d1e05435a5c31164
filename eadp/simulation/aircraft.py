"""The simulated aircraft in wind.

The state is one list, or one array for compiled code (`eadp.core.compiled`), that the functions here change in place.
They run in plain Python or compiled.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence

from eadp.core.expressions.derivatives import Jet
from eadp.core.geometry.curves import Point
from eadp.core.guidance import GRAVITY_MPS2, heading_rate_radps, wind_factor
from eadp.models.vehicle import Airframe, FixedWing, Guidance, PaperVehicle, PowerCurve
from eadp.models.weather import Wind

State = MutableSequence[float]
"""The variables that change from step to step, at the indices below."""

Constants = Sequence[float]
"""The constants of a flight, at the indices below."""

X, Y, ALTITUDE, HEADING, CLIMB, VX, VY, AIR_X, AIR_Y = range(9)
BANK, AIRSPEED, WIND_X, WIND_Y, GUST_X, GUST_Y, NOISE_LEFT = range(9, 16)
AIRCRAFT_STATE = 16
"""Position [m], heading and bank [rad], climb, ground velocity, air velocity, airspeed, wind and gust [m/s]; how many
random numbers are left. Climb is the vertical speed, velocities are along x and y."""

MODEL, STEP_S, K_D, CORRECTED, STEADY_X, STEADY_Y, GUSTS, GUST_KEPT, GUST_NEW = range(9)
MASS, WEIGHT, CRUISE_M, HEIGHT_GAIN, SPEED_HELD = range(9, 14)
LIFT, PER_THROTTLE, NOMINAL, CLIMB_GAIN, IDLE_W, THROTTLE_W, WIND_LIFTS = range(14, 21)
PARASITIC, INDUCED, MIN_SPEED, MAX_BANK, ROLLED, MAX_CLIMB, SPEED_GAIN, EFFICIENCY, AVIONICS_W, MAX_W = range(14, 24)
POINTS = 24
AIRCRAFT_CONSTANTS = 25
"""Constants of every vehicle, and from 14 on those of the papers' aircraft, or in their place those of an aeroplane.
After all constants of a flight come the `POINTS` airspeeds of a power curve [m/s], and the drag at each [N]."""

PAPER_MODEL, AEROPLANE_MODEL = 0.0, 1.0


def constants_of(airframe: Airframe, guidance: Guidance, wind: Wind, step_s: float) -> list[float]:
    """The constants of the aircraft, at the indices above; the airspeeds and drags of a power curve follow.

    Gusts are first-order coloured wind on each axis, exact for any step: w⁺ = a w + σ√(1 − a²) n, a = exp(−Δt/τ).

    Source: Gauss-Markov process.
    """
    c = [0.0] * AIRCRAFT_CONSTANTS
    kept = math.exp(-step_s / wind.gust_time_s)
    # slices of constants are set in the order of their indices
    c[STEP_S : GUST_NEW + 1] = [
        step_s,
        guidance.k_d,
        float(guidance.wind_corrected),
        *wind.steady_mps,
        float(wind.gust_std_mps != 0),
        kept,
        wind.gust_std_mps * math.sqrt(1 - kept**2),
    ]
    c[MASS : CRUISE_M + 1] = [airframe.mass_kg, airframe.weight_n, airframe.cruise_altitude_m]
    c[SPEED_HELD] = airframe.airspeed_mps
    match airframe:  # of another package: as the class that it inherits from
        case PaperVehicle():
            _set_paper_constants(c, airframe)
        case FixedWing():
            _set_fixed_wing_constants(c, airframe, step_s)
        case PowerCurve():
            _set_power_curve_constants(c, airframe, step_s)
    return c


def _set_paper_constants(c: State, airframe: PaperVehicle) -> None:
    """Set the constants of the papers' aircraft."""
    c[MODEL], c[HEIGHT_GAIN] = PAPER_MODEL, airframe.altitude_gain
    c[LIFT : WIND_LIFTS + 1] = [
        airframe.lift_coefficient,
        airframe.speed_per_throttle_mps,
        airframe.nominal_throttle,
        airframe.climb_gain,
        airframe.idle_power_w,
        airframe.throttle_power_w,
        float(airframe.wind_in_lift),
    ]


def _set_fixed_wing_constants(c: State, airframe: FixedWing, step_s: float) -> None:
    """Set the constants of an aeroplane with a drag polar."""
    density_area = 0.5 * airframe.air_density_kgpm3 * airframe.wing_area_m2
    # D = ½ρS C_D0 V² + K (n W)² / (½ρS V²): the two coefficients
    parasitic = density_area * airframe.zero_lift_drag_coefficient
    induced = airframe.induced_drag * airframe.weight_n**2 / density_area
    _set_aeroplane_constants(c, airframe, step_s, parasitic, induced, 0.5 * airframe.stall_mps)


def _set_power_curve_constants(c: list[float], airframe: PowerCurve, step_s: float) -> None:
    """Set the constants of an aeroplane with a power curve, and append its points: airspeeds, then drags."""
    _set_aeroplane_constants(c, airframe, step_s, 0.0, airframe.turn_drag_n, 0.5 * airframe.points[0][0])
    c[POINTS] = len(airframe.points)
    c += [speed for speed, _ in airframe.points]
    c += airframe.drags_n


def _set_aeroplane_constants(
    c: State, airframe: FixedWing | PowerCurve, step_s: float, parasitic: float, induced: float, min_mps: float
) -> None:
    """Set the constants of every aeroplane: two coefficients of its drag, its least airspeed [m/s], and its limits."""
    c[MODEL], c[HEIGHT_GAIN] = AEROPLANE_MODEL, airframe.altitude_gain_per_s
    c[PARASITIC : MAX_W + 1] = [
        parasitic,
        induced,
        min_mps,
        math.radians(airframe.max_bank_deg),
        1 - math.exp(-step_s / airframe.roll_time_constant_s),  # share of a change of bank that one step rolls
        airframe.max_climb_rate_mps,
        airframe.speed_gain_per_s,
        airframe.propulsive_efficiency,
        airframe.avionics_w,
        airframe.max_power_w,
    ]


def state_of(
    airframe: Airframe, wind_mps: Point, position: Point, heading_rad: float, altitude_m: float
) -> list[float]:
    """The state at take-off: straight and level at the cruise airspeed, in a wind [m/s]."""
    s = [0.0] * AIRCRAFT_STATE
    s[X], s[Y] = position
    s[ALTITUDE], s[HEADING], s[AIRSPEED] = altitude_m, heading_rad, airframe.airspeed_mps
    s[AIR_X], s[AIR_Y] = airframe.airspeed_mps * math.cos(heading_rad), airframe.airspeed_mps * math.sin(heading_rad)
    s[VX], s[VY] = s[AIR_X] + wind_mps[0], s[AIR_Y] + wind_mps[1]
    s[WIND_X], s[WIND_Y] = wind_mps
    return s


def fly_step(s: State, c: Constants, jet: Jet, gain: float, sense: float, wind_x: float, wind_y: float) -> float:
    """Fly one step along a path, which changes the state; return the motion power over it [W].

    Parameters
    ----------
    s, c
        The flight's state, which is changed, and its constants.
    jet
        Value, gradient and second derivatives of the path function at the position.
    gain, sense
        Gain k_e of the guidance on the stage, and its direction of travel: +1 for rotation 90, −1 for rotation 270.
    wind_x, wind_y
        Wind over the step [m/s].

    Returns
    -------
    float
        Motion power [W]. Where the path has no direction to follow, the heading in `s` is not finite afterwards.
    """
    if c[MODEL] == AEROPLANE_MODEL:
        return _aeroplane_step(s, c, jet, gain, sense, wind_x, wind_y)
    return _paper_step(s, c, jet, gain, sense, wind_x, wind_y)


def _paper_step(s: State, c: Constants, jet: Jet, gain: float, sense: float, wind_x: float, wind_y: float) -> float:
    """The aircraft of the published flights, stepped in the order they step it.

    Source: docs/reproduction.md "One step", from the letter's published flights.
    """
    step_s = c[STEP_S]
    # 1. guidance from the old position and the previous velocity
    rate = _guided_radps(s, c, jet, gain, sense, s[AIR_X], s[AIR_Y])
    # 2. altitude by throttle
    throttle = c[HEIGHT_GAIN] * (c[CRUISE_M] - s[ALTITUDE]) - c[CLIMB_GAIN] * s[CLIMB]
    airspeed = c[PER_THROTTLE] * (c[NOMINAL] + throttle)
    heading = s[HEADING]
    cosine, sine = math.cos(heading), math.sin(heading)
    lift_speed = airspeed
    if c[WIND_LIFTS] != 0.0:
        lift_speed += wind_x * cosine + wind_y * sine
    lift = c[LIFT] * lift_speed * lift_speed
    s[CLIMB] += (lift - c[WEIGHT]) / c[MASS] * step_s
    s[ALTITUDE] += s[CLIMB] * step_s
    # 3. position, then heading
    s[AIR_X], s[AIR_Y] = airspeed * cosine, airspeed * sine
    s[AIRSPEED] = airspeed
    s[VX], s[VY] = s[AIR_X] + wind_x, s[AIR_Y] + wind_y
    s[X] += s[VX] * step_s
    s[Y] += s[VY] * step_s
    s[HEADING] = _wrapped(heading + rate * step_s)
    return c[THROTTLE_W] * (c[NOMINAL] + throttle) / 100 + c[IDLE_W]


def _aeroplane_step(s: State, c: Constants, jet: Jet, gain: float, sense: float, wind_x: float, wind_y: float) -> float:
    """An aeroplane: bank for the heading rate that the guidance commands, throttle for airspeed and climb.

    Point-mass dynamics with first-order roll; the wind is the air's motion, and a gust changes the airspeed before it
    changes the aircraft's motion.

    Source: Beard and McLain 2012, chapter 9 (guidance models) for the shape of the model; Anderson 1999 for the forces.
    """
    step_s, mass, weight = c[STEP_S], c[MASS], c[WEIGHT]
    heading, speed = s[HEADING], s[AIRSPEED]
    cosine, sine = math.cos(heading), math.sin(heading)
    # 1. guidance: the heading rate that follows the path, held by a bank within its limit
    rate = _guided_radps(s, c, jet, gain, sense, speed * cosine, speed * sine)
    bank = _within(math.atan(rate * speed / GRAVITY_MPS2), c[MAX_BANK])
    s[BANK] += (bank - s[BANK]) * c[ROLLED]
    level = math.cos(s[BANK])
    turn = GRAVITY_MPS2 * math.sin(s[BANK]) / (level * speed)  # g tan φ / V
    # 2. climb rate without lag, within its limit, the glide's and the motor's; airspeed by the throttle, with drag and
    # climb fed forward. D = ½ρS C_D0 V² + K (W / cos φ)² / (½ρS V²)
    climb = _within(c[HEIGHT_GAIN] * (c[CRUISE_M] - s[ALTITUDE]), c[MAX_CLIMB])
    square = speed * speed
    if c[POINTS] == 0.0:
        drag = c[PARASITIC] * square + c[INDUCED] / (level * level * square)
    else:
        # a power curve is of level flight; what a turn adds is induced, by tan² φ = 1/cos² φ − 1
        drag = _curve_drag_n(c, speed) + c[INDUCED] * (1 / (level * level) - 1) / square
    sink = drag * speed / weight  # without thrust
    if climb < -sink:
        climb = -sink
    elif climb > 0.0:
        climb = min(climb, max(c[MAX_W] * c[EFFICIENCY] / weight - sink, 0.0))
    needed = drag + weight * climb / speed + mass * c[SPEED_GAIN] * (c[SPEED_HELD] - speed)
    motor_w = needed * speed / c[EFFICIENCY]  # P = T V / η
    if motor_w < 0.0:
        motor_w = 0.0
    elif motor_w > c[MAX_W]:
        motor_w = c[MAX_W]
    thrust = motor_w * c[EFFICIENCY] / speed
    # acceleration of the air along the heading [m/s²]
    gust = ((wind_x - s[WIND_X]) * cosine + (wind_y - s[WIND_Y]) * sine) / step_s
    s[WIND_X], s[WIND_Y] = wind_x, wind_y
    # m V̇ = T − D − W sin γ, less the air's own acceleration along the heading
    speed += ((thrust - drag - weight * climb / speed) / mass - gust) * step_s
    if speed < c[MIN_SPEED]:
        speed = c[MIN_SPEED]
    s[AIRSPEED], s[CLIMB] = speed, climb
    s[ALTITUDE] += climb * step_s
    # 3. position, then heading; the climb takes its part of the airspeed
    level_mps = math.sqrt(max(speed * speed - climb * climb, 0.0))
    s[AIR_X], s[AIR_Y] = level_mps * cosine, level_mps * sine
    s[VX], s[VY] = s[AIR_X] + wind_x, s[AIR_Y] + wind_y
    s[X] += s[VX] * step_s
    s[Y] += s[VY] * step_s
    s[HEADING] = _wrapped(heading + turn * step_s)
    return motor_w + c[AVIONICS_W]


def _curve_drag_n(c: Constants, speed: float) -> float:
    """Drag of a power curve in level flight [N]: linear between its points, constant beyond."""
    # the last of the constants: `count` airspeeds, ascending, then the drags at them
    count = int(c[POINTS])
    speeds, drags = len(c) - 2 * count, len(c) - count
    if speed <= c[speeds]:
        return c[drags]
    if speed >= c[drags - 1]:
        return c[drags + count - 1]
    i = 0  # the last point that is not above the speed
    while speed >= c[speeds + i + 1]:
        i += 1
    low, high = c[speeds + i], c[speeds + i + 1]
    return c[drags + i] + (c[drags + i + 1] - c[drags + i]) * (speed - low) / (high - low)


def _guided_radps(s: State, c: Constants, jet: Jet, gain: float, sense: float, air_x: float, air_y: float) -> float:
    """The heading rate that the guidance commands [rad/s]."""
    rate = heading_rate_radps(jet, s[VX], s[VY], gain, c[K_D], sense)
    if c[CORRECTED] != 0.0:
        rate *= wind_factor(s[VX], s[VY], air_x, air_y)
    return rate


def _within(value: float, limit: float) -> float:
    """A value limited to ±limit; NaN stays."""
    if value > limit:
        return limit
    return -limit if value < -limit else value


def _wrapped(heading: float) -> float:
    """The same direction within ±π, exactly; a value that is not finite stays."""
    if -math.pi < heading <= math.pi or not math.isfinite(heading):
        return heading
    turned = heading % (2 * math.pi)
    return turned - 2 * math.pi if turned > math.pi else turned


def advance_gust(s: State, c: Constants, noise: Sequence[float]) -> None:
    """Change the gust to that of the next step, with the last two normal random numbers that are left."""
    # w⁺ = a w + σ√(1 − a²) n
    left = int(s[NOISE_LEFT])
    s[GUST_X] = c[GUST_KEPT] * s[GUST_X] + c[GUST_NEW] * noise[left - 1]
    s[GUST_Y] = c[GUST_KEPT] * s[GUST_Y] + c[GUST_NEW] * noise[left - 2]
    s[NOISE_LEFT] -= 2
