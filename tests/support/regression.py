"""Bayesian linear regression, as an oracle."""

import numpy as np


def posterior(rows, values, noise, prior, spread):
    """Bayesian linear regression by the formulas of any textbook: mean and covariance."""
    rows, values = np.asarray(rows, dtype=float), np.asarray(values, dtype=float)
    first, weights = np.diag(1 / np.asarray(spread) ** 2), np.diag(1 / np.asarray(noise))
    covariance = np.linalg.inv(first + rows.T @ weights @ rows)
    return covariance @ (first @ prior + rows.T @ weights @ values), covariance
