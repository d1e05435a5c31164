"""Scaling factors ν and τ: û = ν c + τ takes a parameter to seconds (a path) or to watts (a computation).

Source: letter, Eqs. 9-11.
"""

from __future__ import annotations


def path_scaling(low: float, high: float, shortest_s: float, longest_s: float, count: int) -> tuple[float, float]:
    """ν and τ of one of `count` path parameters that share the coverage time between them.

    Parameters
    ----------
    low, high : float
        The parameter's set.
    shortest_s, longest_s : float
        Time of the whole coverage with all path parameters at their lowest and at their highest, t̲ and t̄ [s].
    count : int
        ρ.

    Returns
    -------
    nu, tau : float
        [s per unit] and [s]: ν c + τ is t̲/ρ at `low` and t̄/ρ at `high`; a set of one value has ν = 0 and its share of
        t̄.

    Source: letter, Eq. 10; its τ does not give t̲ at c̲ as printed and is corrected.
    """
    if low == high:
        return 0.0, longest_s / count
    # ν = (t̄ − t̲)/(c̄ − c̲)/ρ,  τ = (c̲ (t̲ − t̄)/(c̄ − c̲) + t̲)/ρ
    nu = (longest_s - shortest_s) / (high - low) / count
    tau = (low * (shortest_s - longest_s) / (high - low) + shortest_s) / count
    return nu, tau


def computation_scaling(low: float, high: float, low_w: float, high_w: float) -> tuple[float, float]:
    """ν and τ of a computation whose power is `low_w` at `low` and `high_w` at `high` [W].

    Returns
    -------
    nu, tau : float
        [W per unit] and [W]; a set of one value has ν = 0 and its power.

    Source: letter, Eq. 11.
    """
    if low == high:
        return 0.0, low_w
    # ν = (g(c̄) − g(c̲))/(c̄ − c̲),  τ = c̲ (g(c̲) − g(c̄))/(c̄ − c̲) + g(c̲)
    nu = (high_w - low_w) / (high - low)
    tau = low * (low_w - high_w) / (high - low) + low_w
    return nu, tau
