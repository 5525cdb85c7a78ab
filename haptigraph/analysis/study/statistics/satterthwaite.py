"""Standard errors and degrees of freedom of fixed effects in a linear model with a random intercept.

statsmodels has no degrees of freedom. These are Satterthwaite's (1946), as in R's lmerTest (Kuznetsova,
Brockhoff & Christensen, J. Stat. Softw. 82(13), 2017): df = 2 v^2 / (g' A g), where v is the variance of an
estimate, g its gradient by the variance parameters, and A their covariance, twice the inverse Hessian of the
REML deviance.
"""

from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from statsmodels.tools.numdiff import approx_fprime, approx_hess3

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

__all__ = ["errors_and_df"]

SINGULAR = 1e-4  # ratio of standard deviations, between to within, as lme4's isSingular


class _Sums(Struct, frozen=True):
    """What the likelihood needs of the data: with a random intercept, sums by participant suffice."""

    sizes: "Floats"
    """(groups,)"""
    by_group: "Floats"
    """(groups, p + 1) sums of the design's columns and of the response."""
    products: "Floats"
    """(p + 1, p + 1)"""

    def weighted(self, log_variances: "Floats") -> "Floats":
        """Return the products weighted by the inverse covariance: (p + 1, p + 1)."""
        within, between = np.exp(log_variances)
        shared = (between / (within + self.sizes * between))[:, None] * self.by_group
        return np.asarray((self.products - self.by_group.T @ shared) / within)

    def deviance(self, log_variances: "Floats") -> float:
        """Return -2 times the restricted log-likelihood, but for a constant."""
        within, between = np.exp(log_variances)
        product = self.weighted(log_variances)
        information, projected = product[:-1, :-1], product[:-1, -1]
        residual = product[-1, -1] - projected @ np.linalg.solve(information, projected)
        covariance = (self.sizes - 1) * log_variances[0] + np.log(within + self.sizes * between)
        return float(covariance.sum() + np.linalg.slogdet(information)[1] + residual)

    def variances(self, log_variances: "Floats") -> "Floats":
        """Return the variances of the estimates: (p,)."""
        return np.asarray(np.diag(np.linalg.inv(self.weighted(log_variances)[:-1, :-1])))


def errors_and_df(
    design: "Floats",
    response: "Floats",
    groups: "NDArray[np.intp]",
    participant_sd: float,
    residual_sd: float,
) -> "tuple[Floats, Floats]":
    """Return the standard error and the degrees of freedom of each fixed effect.

    Args:
        design: (n, p) of full rank.
        response: (n,)
        groups: (n,) numbers of the participants, from 0.
        participant_sd: Of the intercepts, at the REML estimate; near zero, all degrees of freedom are n - p.
        residual_sd: Of the residuals.

    Returns:
        (p,) and (p,)
    """
    count, columns = design.shape
    both = np.column_stack((design, response))
    by_group = np.zeros((int(groups.max()) + 1, columns + 1))
    np.add.at(by_group, groups, both)
    sums = _Sums(np.bincount(groups).astype(np.float64), by_group, both.T @ both)
    smallest_sd = SINGULAR * residual_sd
    at = 2 * np.log([residual_sd, max(participant_sd, smallest_sd)])
    variances = sums.variances(at)
    if participant_sd <= smallest_sd:
        return np.sqrt(variances), np.full(columns, float(count - columns))
    covariance = 2 * np.linalg.inv(approx_hess3(at, sums.deviance))
    gradient = approx_fprime(at, sums.variances, centered=True)
    spread = np.einsum("ij,jk,ik->i", gradient, covariance, gradient)
    return np.sqrt(variances), 2 * variances**2 / spread
