"""The charge at the end as a mixture of normal distributions, against draws."""

import numpy as np
import pytest

from eadp.models.battery import LOSS
from eadp.planning.forecast.battery_limits import LOSS_SQUARE, MIN_STD, FinalCharge, moments


@pytest.mark.parametrize("seed", range(4))
def test_the_charge_at_several_ends_is_a_mixture(seed):
    """Probabilities and moments beside draws; the level is the one that they leave below."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 4))
    shares, means = rng.dirichlet(np.ones(count)), rng.uniform(0, 0.3, count)
    ends = FinalCharge(float(rng.uniform(0.005, 0.05)), tuple(shares.tolist()), tuple(means.tolist()))
    drawn = means[rng.choice(count, 400_000, p=shares)] + ends.std * rng.standard_normal(400_000)
    assert ends.mean == pytest.approx(drawn.mean(), abs=1e-3)
    assert ends.variance == pytest.approx(drawn.var(), rel=0.02)
    for soc in (0.0, 0.05, 0.15):
        assert ends.probability_above(soc) == pytest.approx(np.mean(drawn > soc), abs=0.004)
    for probability in (0.5, 0.8, 0.95):
        assert np.mean(drawn > ends.level(probability)) == pytest.approx(probability, abs=0.004)


def test_a_forecast_without_a_spread_is_sure():
    assert FinalCharge(0.0, means=(0.1,)).probability_above(0.05) == 1
    assert FinalCharge(0.0, means=(0.04,)).probability_above(0.05) == 0
    assert FinalCharge(MIN_STD / 9, means=(0.04,)).probability_above(0.0) == 1


def test_moments_of_losses_are_those_of_draws():
    drawn = np.random.default_rng(1).uniform(0.02, 0.12, 1_000_000)
    assert pytest.approx(drawn.mean(), rel=1e-3) == LOSS
    assert pytest.approx((drawn**2).mean(), rel=1e-3) == LOSS_SQUARE
    assert moments((0.25, 0.75), (1.0, 3.0)) == pytest.approx((2.5, 0.75))
