"""Roots in bands and beside causes against the whole matrix, by NumPy alone."""

from __future__ import annotations

import numpy as np
import pytest

from estim.problem import STENCILS, differentiate
from estim.problem.differences import covariance_in_bands, in_rows, used_columns
from estim.problem.roots import BandedFactor, Dense, LowRankRoot, Stacked, covariance_of


def _stencil(n, name="central", rng=None):
    t = np.delete(np.arange(n + 4) * 0.01, [n // 7, n // 7 + 1, n // 3])  # frames are missing
    matrix = differentiate(t, np.zeros(t.size), STENCILS[name]).matrix
    slope = (
        np.linspace(30.0, 0.5, matrix.shape[0])
        if rng is None
        else rng.uniform(0.5, 30.0, matrix.shape[0])
    )
    rows = differentiate(t, np.zeros(t.size), STENCILS[name]).rows
    return matrix - in_rows(rows[:, None], slope[:, None], t.size)


def _roots(n=300):
    rng = np.random.default_rng(2)
    matrix = _stencil(n)
    bands, dense = covariance_in_bands(matrix), matrix.toarray() @ matrix.toarray().T
    band = BandedFactor.of(bands)
    size = np.sqrt(np.diag(dense))
    causes = np.column_stack(
        [
            np.ones(band.n_obs),
            np.linspace(-1.0, 1.0, band.n_obs) ** 2,
            rng.standard_normal((band.n_obs, 9)).cumsum(axis=0),
        ]
    )
    causes = 0.1 * causes  # as large as errors usually are: beyond, the whole matrix loses digits
    columns = size[:, None] * causes
    yield pytest.param(band, dense, id="band")
    yield pytest.param(
        LowRankRoot.of(band, band.whiten(columns.T).T), dense + columns @ columns.T, id="beside"
    )
    once = LowRankRoot.of(band, band.whiten(columns[:, :2].T).T)
    yield pytest.param(
        LowRankRoot.of(once, once.whiten(columns[:, 2:].T).T),
        dense + columns @ columns.T,
        id="beside-twice",
    )
    yield pytest.param(
        LowRankRoot.of(BandedFactor.of(size[None] ** 2), causes),
        np.diag(size**2) + columns @ columns.T,
        id="beside-points",
    )
    yield pytest.param(Dense.of(dense), dense, id="dense")
    both = np.block(
        [[dense, np.zeros((len(dense), 2))], [np.zeros((2, len(dense))), np.diag([4.0, 9.0])]]
    )
    yield pytest.param(Stacked((band, BandedFactor.of(np.array([[4.0, 9.0]])))), both, id="stacked")


@pytest.mark.parametrize(("root", "dense"), list(_roots()))
def test_a_root_is_that_of_the_whole_matrix(root, dense):
    rows = np.random.default_rng(7).standard_normal((5, dense.shape[0])) * np.sqrt(np.diag(dense))
    lower = np.linalg.cholesky(dense)
    np.testing.assert_allclose(covariance_of(root), dense, rtol=0.0, atol=1e-10 * np.max(dense))
    np.testing.assert_allclose(
        root.whiten(rows), np.linalg.solve(lower, rows.T).T, rtol=1e-10, atol=1e-10
    )
    slopes = rows / np.diag(dense)
    np.testing.assert_allclose(
        root.turned_back(slopes),
        np.linalg.solve(lower.T, slopes.T).T,
        rtol=1e-10,
        atol=1e-10 * np.max(np.abs(slopes)),
    )
    np.testing.assert_allclose(
        root.coloured(root.whiten(rows)), rows, rtol=1e-10, atol=1e-9 * np.max(np.abs(rows))
    )
    np.testing.assert_allclose(root.whiten(rows[0]), root.whiten(rows)[0], rtol=1e-12, atol=1e-12)
    assert root.log_volume == pytest.approx(0.5 * np.linalg.slogdet(dense)[1], rel=1e-12, abs=1e-10)
    np.testing.assert_allclose(root.variances, np.diag(dense), rtol=1e-10)
    np.testing.assert_allclose(root.precisions, np.diag(np.linalg.inv(dense)), rtol=1e-8)
    np.testing.assert_allclose(
        covariance_of(root.times(3.0)), 9.0 * dense, rtol=0.0, atol=1e-9 * np.max(dense)
    )


@pytest.mark.parametrize("name", STENCILS)
def test_the_bands_of_a_stencil_are_its_covariance(name):
    matrix = _stencil(300, name, np.random.default_rng(3))
    dense, bands = matrix.toarray() @ matrix.toarray().T, covariance_in_bands(matrix)
    whole = np.zeros(dense.shape)
    for d, band in enumerate(bands):
        whole += np.diag(band[: len(band) - d], -d) + (
            np.diag(band[: len(band) - d], d) if d else 0.0
        )
    np.testing.assert_allclose(whole, dense, rtol=0.0, atol=1e-12 * np.max(dense))
    # one band too few
    wrong = BandedFactor.of(
        bands[:-1] + np.array([[1.0], *[[0.0]] * (len(bands) - 2)]) * np.max(bands[-1] ** 2) ** 0.5
    )
    rows = np.ones((1, len(dense)))
    right = np.linalg.solve(np.linalg.cholesky(dense), rows.T).T
    assert np.max(np.abs(BandedFactor.of(bands).whiten(rows) - right)) < 1e-10 * np.max(
        np.abs(right)
    )
    assert np.max(np.abs(wrong.whiten(rows) - right)) > 1e-3 * np.max(np.abs(right))


def test_a_matrix_in_rows_has_its_weights_at_their_places():
    places, weights = (
        np.array([[0, 4], [3, 1], [4, 4]]),
        np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]),
    )
    matrix = in_rows(places, weights, 6)
    dense = [
        [1.0, 0.0, 0.0, 0.0, 2.0, 0.0],
        [0.0, 4.0, 0.0, 3.0, 0.0, 0.0],
        [0.0] * 4 + [11.0, 0.0],
    ]
    np.testing.assert_array_equal(matrix.toarray(), dense)
    np.testing.assert_array_equal(used_columns(matrix), [0, 1, 3, 4])


@pytest.mark.parametrize("correlation", [0.3, 0.85])
def test_errors_that_follow_each_other_are_cut_where_nothing_is_left(correlation):
    matrix = _stencil(400)
    apart = np.abs(np.subtract.outer(np.arange(matrix.shape[1]), np.arange(matrix.shape[1])))
    dense = matrix.toarray() @ correlation**apart @ matrix.toarray().T
    root = BandedFactor.of(covariance_in_bands(matrix, correlation))
    assert len(root.lower) < 230
    np.testing.assert_allclose(covariance_of(root), dense, rtol=0.0, atol=1e-12 * np.max(dense))
    rows = np.random.default_rng(1).standard_normal((2, root.n_obs))
    np.testing.assert_allclose(
        root.whiten(rows),
        np.linalg.solve(np.linalg.cholesky(dense), rows.T).T,
        rtol=1e-9,
        atol=1e-9,
    )
