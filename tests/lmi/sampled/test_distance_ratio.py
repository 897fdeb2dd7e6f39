"""How far the states may be for a storage V: a form that doubles do not show to be definite ends no search."""

import numpy as np
import pytest

from lockstep.lmi.sampled import storage


@pytest.mark.parametrize("scale", [1.0, 1e150])
def test_the_ratio_is_the_largest_generalised_eigenvalue(monkeypatch, scale):
    """V = 4 (x / s)^2 + (y / s)^2 of |x|^2 + |y|^2 is at least the distance s^2 / 4 and s^2: c = s^2, with its thousandth."""
    monkeypatch.setattr(storage, "metric_of", lambda _loop: np.eye(2))
    P = np.diag([4.0, 1.0]) / scale**2
    assert storage.distance_ratio(None, P) == pytest.approx(1.001 * scale**2)


def test_a_form_that_rounding_made_indefinite_has_a_large_ratio(monkeypatch):
    """Problem 792 of benchmarks/pipelines.py ended with numpy's LinAlgError."""
    monkeypatch.setattr(storage, "metric_of", lambda _loop: np.eye(2))
    P = np.array([[1.0, 1.0 + 1e-15], [1.0 + 1e-15, 1.0]])
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(P)
    assert storage.distance_ratio(None, P) > 1e12
