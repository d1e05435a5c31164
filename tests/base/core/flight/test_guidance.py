"""The guiding vector field against the drafts' matrices, differences; the drag polar, by hand and by minimisation."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eadp.core.expressions.derivatives import bind
from eadp.core.expressions.reader import read_expression
from eadp.core.guidance import (
    GRAVITY_MPS2,
    WIND_FACTOR_LIMIT,
    drag_n,
    dynamic_pressure_pa,
    heading_rate_radps,
    induced_drag_factor,
    load_factor,
    turn_radius_m,
    wind_factor,
)

RADPS = 1e-9
DIFFERENCE_RADPS = 1e-5
E = np.array([[0.0, -1.0], [1.0, 0.0]])
AIRSPEED_MPS = 15.0

PATHS = {
    "line": ("3*x+4*y-10", 0.05),
    "circle": ("(x+45)^2+(y-146)^2-4900", 3e-4),
    "ellipse": ("x^2+2*y^2+x*y-900", 1e-3),
    "sine": ("y-10*sin(x/20)", 0.05),
}
names = st.sampled_from(sorted(PATHS))
coordinate = st.floats(-200, 200)
angles = st.floats(-math.pi, math.pi)
senses = st.sampled_from([1, -1])
gains = st.floats(-2, 2)


def path_of(name):
    text, gain = PATHS[name]
    return bind(read_expression(text), {}), gain


def desired(path, position, gain, sense):
    """ṗ_d = τ − k_e φ ∇φ with τ = R(rotation) ∇φ."""
    phi, gx, gy, *_ = path(*position)
    gradient = np.array([gx, gy])
    return sense * E @ gradient - gain * phi * gradient


def by_matrices(path, position, velocity, k_e, k_d, sense):
    """The drafts' equations as 01-model prints them, matrix by matrix."""
    phi, gx, gy, hxx, hxy, hyy = path(*position)
    gradient, hessian = np.array([[gx], [gy]]), np.array([[hxx, hxy], [hxy, hyy]])
    rotation = E if sense == 1 else E.T
    p_dot = np.array(velocity).reshape(2, 1)
    tau = rotation @ gradient
    pd_dot = tau - k_e * phi * gradient
    pd_ddot = (rotation - k_e * phi * np.eye(2)) @ hessian @ p_dot - k_e * (gradient.T @ p_dot) * gradient
    norm = np.linalg.norm(pd_dot)
    turned = -E @ pd_dot @ pd_dot.T @ E @ pd_ddot / norm**3
    chi_dot = turned.T @ E @ pd_dot / norm
    towards = p_dot.T @ E @ pd_dot / (np.linalg.norm(p_dot) * norm)
    return float((chi_dot - k_d * towards).item())


@given(names, coordinate, coordinate, angles, st.floats(1, 30), gains, senses)
def test_heading_rate_is_the_drafts(name, x, y, course, speed, k_d, sense):
    path, k_e = path_of(name)
    assume(np.linalg.norm(desired(path, (x, y), k_e, sense)) > 1e-3)
    vx, vy = speed * math.cos(course), speed * math.sin(course)
    wanted = by_matrices(path, (x, y), (vx, vy), k_e, k_d, sense)
    got = heading_rate_radps(path(x, y), vx, vy, k_e, k_d, sense)
    assert got == pytest.approx(wanted, rel=1e-7, abs=RADPS)


@given(names, coordinate, coordinate, angles, senses)
def test_without_k_d_it_is_how_fast_the_desired_direction_turns(name, x, y, course, sense):
    path, k_e = path_of(name)
    vx, vy = AIRSPEED_MPS * math.cos(course), AIRSPEED_MPS * math.sin(course)
    dt = 1e-6

    def direction(t):
        return desired(path, (x + vx * t, y + vy * t), k_e, sense)

    assume(np.linalg.norm(direction(0)) > 0.5)
    before, after = direction(-dt), direction(dt)
    turned = math.atan2(before[0] * after[1] - before[1] * after[0], before @ after)
    got = heading_rate_radps(path(x, y), vx, vy, k_e, 0.0, sense)
    assert got == pytest.approx(turned / (2 * dt), rel=1e-4, abs=DIFFERENCE_RADPS)


@pytest.mark.parametrize("k_d", [0.0, 1.0])
def test_at_a_critical_point_the_heading_is_kept(k_d):
    path, k_e = path_of("circle")
    assert heading_rate_radps(path(-45.0, 146.0), 10.0, 5.0, k_e, k_d, 1) == 0
    assert heading_rate_radps(path(25.0, 146.0), 0.0, 0.0, k_e, k_d, 1) == 0, "hovering against the wind"
    for d in (1e-8, 1e-12, 1e-200):
        assert math.isfinite(heading_rate_radps(path(-45.0 + d, 146.0), 10.0, 5.0, k_e, k_d, 1))


@given(angles, angles, st.floats(0, 9.9))
def test_wind_factor_is_how_much_faster_the_heading_turns(heading, towards, speed):
    wind = speed * np.array([math.cos(towards), math.sin(towards)])

    def ground(theta):
        return AIRSPEED_MPS * np.array([math.cos(theta), math.sin(theta)]) + wind

    d = 1e-6
    before, after = ground(heading - d), ground(heading + d)
    course_per_heading = math.atan2(before[0] * after[1] - before[1] * after[0], before @ after) / (2 * d)
    air, velocity = ground(heading) - wind, ground(heading)
    got = wind_factor(*velocity, *air)
    wanted = 1 / course_per_heading
    assert got == pytest.approx(min(max(wanted, 1 / WIND_FACTOR_LIMIT), WIND_FACTOR_LIMIT), rel=1e-6)
    # ‖ṗ‖ / (s cos(θ − χ)) as 01-model prints it
    course = math.atan2(velocity[1], velocity[0])
    assert wanted == pytest.approx(np.linalg.norm(velocity) / (AIRSPEED_MPS * math.cos(heading - course)), rel=1e-6)


def flown(name, start, heading, sense, *, k_d=1.0, wind=(0.0, 0.0), seconds=60.0, step_s=0.02):
    """Positions of a point that turns its air velocity as the law says."""
    path, k_e = path_of(name)
    (x, y), theta = start, heading
    positions = []
    for _ in range(round(seconds / step_s)):
        ax, ay = AIRSPEED_MPS * math.cos(theta), AIRSPEED_MPS * math.sin(theta)
        vx, vy = ax + wind[0], ay + wind[1]
        rate = heading_rate_radps(path(x, y), vx, vy, k_e, k_d, sense) * wind_factor(vx, vy, ax, ay)
        x, y, theta = x + vx * step_s, y + vy * step_s, theta + rate * step_s
        positions.append((x, y))
    return np.array(positions)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("wind", [(0.0, 0.0), (5.0, 0.0)])
@pytest.mark.parametrize("start", [(100.0, 146.0), (-45.0, 166.0), (-45.0, -50.0)])
def test_it_leads_onto_a_circle_and_round_it(start, wind, sense):
    positions = flown("circle", start, 0.5, sense, wind=wind) - [-45, 146]
    radius = np.hypot(positions[:, 0], positions[:, 1])
    assert np.abs(radius[-500:] - 70).max() < 0.5
    turned = np.unwrap(np.arctan2(positions[-500:, 1], positions[-500:, 0]))
    assert sense * (turned[-1] - turned[0]) > 1


def test_the_published_sign_of_k_d_leads_nowhere():
    away = flown("line", (60.0, 80.0), 2.0, 1, k_d=-1.0)
    distance = np.abs(3 * away[:, 0] + 4 * away[:, 1] - 10) / 5
    assert distance[-500:].max() > 5


speeds = st.floats(6, 60)
banks = st.floats(-1.2, 1.2)


def test_a_wing_worked_out_by_hand():
    # 20 m/s at sea level: q = 245 Pa; 24.5 N on 0.5 m²: C_L = 0.2; C_D = 0.02 + 0.2²/(π·0.8·5) = 0.023183
    assert dynamic_pressure_pa(20, 1.225) == pytest.approx(245)
    assert induced_drag_factor(5, 0.8) == pytest.approx(1 / (4 * math.pi))
    assert drag_n(24.5, 20, 0.5, 1.225, 0.02, 1 / (4 * math.pi)) == pytest.approx(245 * 0.5 * 0.0231831, rel=1e-5)


@given(speeds, banks)
def test_a_level_turn_balances_weight_and_centripetal_force(speed, bank):
    # lift n W: its upright part carries the weight, the other part turns: m V ω
    mass = 1.7
    turn_rate_radps = GRAVITY_MPS2 * math.tan(bank) / speed
    lift = load_factor(bank) * mass * GRAVITY_MPS2
    assert lift * math.cos(bank) == pytest.approx(mass * GRAVITY_MPS2)
    assert lift * math.sin(bank) == pytest.approx(mass * speed * turn_rate_radps, abs=1e-9)
    assert abs(bank) < 1e-6 or turn_radius_m(speed, bank) * turn_rate_radps == pytest.approx(speed)
