"""Both errors of scanned poses: weighted once and asked often, as by the normal equations."""

from __future__ import annotations

import numpy as np
import pytest

from tests.plugins.calibration.conftest import CENTER, TRUE, scan_recording, scans_over, whole_covariance
from workbench.api import estimator
from workbench.plugins.calibration import circles
from workbench.plugins.calibration.model import Estimate, Noise, Sphere, linearise, rows_of
from workbench.plugins.calibration.observations import by_pass
from workbench.plugins.calibration.shared_errors import WHOLE, _Likelihood, _prior_of_scans, settled


@pytest.fixture(scope="module")
def scanned() -> tuple[estimator.Fit[Estimate], Sphere]:
    rng = np.random.default_rng(2)
    rec = scan_recording(rng, scans_over(rng, 5), own=False, frames=30)
    sphere = Sphere(by_pass(circles(rec), rec), Noise())
    return estimator.fit(sphere, Estimate(TRUE[:3, :3], TRUE[:3, 3], CENTER, 5.0)), sphere


@pytest.mark.parametrize(("whole", "own"), [(0.0, 1.0), (1.0, 0.5), (0.4, 0.9)])
def test_answers_are_those_of_the_normal_equations(
    scanned: tuple[estimator.Fit[Estimate], Sphere], whole: float, own: float
) -> None:
    """With both errors told to them. The product of both in the square of c_y is left out."""
    found, sphere = scanned
    likely = _Likelihood(found.at, sphere, found.used)

    def asked(a: float, b: float) -> tuple[float, np.ndarray, np.ndarray]:
        noise, seen = likely.noise(a, b), sphere.seen.place()
        linear = linearise(found.at, seen, noise)
        now = rows_of(linear, seen, noise, found.at.radius_mm).normal()
        covariance = np.linalg.inv(now.information)
        step = covariance @ now.side
        size = np.linalg.slogdet(whole_covariance(linear, seen, noise))[1]
        log = -0.5 * (now.chi2 - now.side @ step + np.linalg.slogdet(now.information)[1] + size)
        return log, step, covariance

    here = likely.along(np.array([whole]), own)
    log, step, covariance = asked(whole, own)
    u = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(here.step[0] / u, step / u, atol=0.1)
    np.testing.assert_allclose(here.covariance[0] / np.outer(u, u), covariance / np.outer(u, u), atol=0.05)
    assert here.log[0] == pytest.approx(log, abs=0.5)


def test_own_errors_lie_about_the_likeliest(scanned: tuple[estimator.Fit[Estimate], Sphere]) -> None:
    """Five scans of 30 frames tell them to a tenth; beyond them the probability falls."""
    found, sphere = scanned
    likely = _Likelihood(found.at, sphere, found.used)
    owns = likely.owns()
    assert 0.8 < owns[2] < 1.25
    assert 0.02 < np.log(owns[3] / owns[2]) < 0.2
    log = [float(np.logaddexp.reduce(likely.along(WHOLE, b).log + _prior_of_scans(WHOLE, b))) for b in owns]
    assert log[2] == max(log)
    assert log[2] - np.array(log)[[1, 3]] == pytest.approx([0.5, 0.5], abs=0.2)


def test_a_size_that_scans_tell_badly_widens_the_covariance(scanned: tuple[estimator.Fit[Estimate], Sphere]) -> None:
    found, sphere = scanned
    few = settled(found, sphere)
    sure = _Likelihood(found.at, sphere, found.used).along(np.zeros(1), 1.0).covariance[0]
    assert np.trace(np.linalg.solve(sure[:6, :6], few.covariance[:6, :6])) > 6.0
    louder = settled(found, sphere.noisy(Noise(0.02, 0.003)))
    assert louder.misfit
    assert not few.misfit
