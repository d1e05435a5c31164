"""Scaling factors ν and τ: û = ν c + τ takes a parameter to seconds (a path) or to watts (a computation).

Source: letter, Eqs. 9-11.
"""

from __future__ import annotations


def scaling_factors(low: float, high: float, at_low: float, at_high: float) -> tuple[float, float]:
    """ν and τ of a parameter.

    Parameters
    ----------
    low, high : float
        The parameter's set.
    at_low, at_high : float
        û at its ends. Of a computation its power [W], of one of ρ path parameters its share of the time of the whole
        coverage [s]: t̲/ρ with all of them at their lowest and t̄/ρ at their highest.

    Returns
    -------
    nu, tau : float
        [W or s per unit] and [W or s]; a set of one value has ν = 0 and what holds at `high`.

    Source: letter, Eqs. 10 and 11; the τ of Eq. 10 does not give t̲ at c̲ as printed and is corrected.
    """
    if low == high:
        return 0.0, at_high
    # ν = (g(c̄) − g(c̲))/(c̄ − c̲),  τ = c̲ (g(c̲) − g(c̄))/(c̄ − c̲) + g(c̲)
    nu = (at_high - at_low) / (high - low)
    tau = low * (at_low - at_high) / (high - low) + at_low
    return nu, tau
