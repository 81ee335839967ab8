"""Bad frames: the scan against evidence by dense matrices, found and named where there are some,
and nobody accused where there are none.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.sparse import csr_array, eye_array
from test_noise import DIFFERENTIATED
from test_unmodelled_force import KEY, body, nearby

from estim.campaign import Campaign, load_campaign
from estim.checks.outliers import bad_frames_found, too_many_bad_frames
from estim.common import InputError
from estim.discrepancy.bad_frame_search import MOST, PRIOR, BadFrames, Frames, find_bad_frames
from estim.discrepancy.grid import prior_grid
from estim.discrepancy.scale_mixture import Shape, diagonalise
from estim.fitting import fit_problem
from estim.problem.roots import root_of
from estim.words import describe

N, SD = 24, 0.5
T = np.arange(N) * 0.1
WHEEL = Path(__file__).resolve().parents[1] / "data" / "wheel"
CURVE = np.column_stack([np.ones(N), T, T**2])
FLAT = np.zeros((3, 3))


def frames(matrix: np.ndarray | None = None, *, in_sequence: bool = True) -> Frames:
    matrix = np.eye(N) if matrix is None else matrix
    sparse = csr_array(matrix)
    return Frames(sparse, 3.0 + 2.0 * T, SD, in_sequence, T, 3.0 * T + T**2, np.arange(N) + 2)


def scanned(y: np.ndarray, known: Frames | None = None) -> BadFrames:
    """Of a parabola whose errors are white, with or without a smooth deviation."""
    smooth = np.exp(-0.5 * np.square((T[:, None] - T) / 0.5))
    shape = Shape("deviation", 0.5, np.linalg.cholesky(smooth + 1e-9 * np.eye(N)), 0.0)
    deviation = diagonalise(
        root_of(np.full(y.size, SD**2)), (shape,), prior_grid(1.0, scales=(1.0, 2.0), n_amplitude=3)
    )
    precision = np.diag([1e-6, 1e-6, 1e-6])
    return find_bad_frames(
        deviation,
        frames() if known is None else known,
        y,
        CURVE[: y.size],
        precision=precision,
        pull=np.zeros(3),
    )


def errors(seed: int) -> np.ndarray:
    return SD * np.random.default_rng(seed).standard_normal(N)


def evidence(y: np.ndarray, column: np.ndarray | None) -> float:
    """log p(y) with the same priors, summed over the grid by dense normal densities."""
    smooth = np.exp(-0.5 * np.square((T[:, None] - T) / 0.5)) + 1e-9 * np.eye(N)
    grid = prior_grid(1.0, scales=(1.0, 2.0), n_amplitude=3)
    total = []
    for size, log_size in (
        [(0.0, -np.inf)]
        if column is None
        else [(s * SD, -np.log(3.0)) for s in (10.0, 100.0, 1000.0)]
    ):
        jump = np.zeros((N, N)) if column is None else size**2 * np.outer(column, column)
        for a, log_a in zip(grid.amplitudes, grid.log_amplitudes, strict=True):
            for s, log_s in zip(grid.scales, grid.log_scales, strict=True):
                cov = (s * SD) ** 2 * np.eye(N) + a**2 * smooth + 1e6 * CURVE @ CURVE.T + jump
                log = log_a + log_s + (0.0 if column is None else log_size)
                total.append(
                    log + stats.multivariate_normal(np.zeros(N), cov, allow_singular=True).logpdf(y)
                )
    return float(np.logaddexp.reduce(total))


def test_the_odds_of_a_step_are_the_ratio_of_two_evidences() -> None:
    y = errors(3) + np.where(np.arange(N) >= 11, 8.0 * SD, 0.0)
    (jump,) = scanned(y).jumps
    patterns = N + 2 * (N - 3)
    odds = (
        sum(
            np.exp(evidence(y, column) - evidence(y, None))
            for column in [
                *np.eye(N),
                *(np.where(np.arange(N) >= k, 1.0, 0.0) for k in range(2, N - 1)),
            ]
        )
        * PRIOR
        / patterns
    )
    # beside these the clocks, which explain next to nothing of it
    assert jump.probability == pytest.approx(odds / (1.0 + odds), abs=0.02)


def test_a_step_a_frame_and_a_clock_are_named_with_their_sizes() -> None:
    index = np.arange(N)
    (step,) = scanned(errors(1) - np.where(index >= 9, 12.0 * SD, 0.0)).jumps
    assert (step.kind, step.row, step.line, step.t) == ("step", 9, 11, pytest.approx(0.9))
    assert step.size == pytest.approx(-12.0 * SD, abs=3.0 * step.sd)
    assert 0.2 * SD < step.sd < 3.0 * SD
    (frame,) = scanned(errors(2) + np.where(index == 15, 9.0 * SD, 0.0)).jumps
    assert (frame.kind, frame.row) == ("frame", 15)
    lost = np.where(index >= 12, 0.1 * (3.0 + 2.0 * T), 0.0) * 10.0
    fast = Frames(eye_array(N, format="csr"), 10.0 * (3.0 + 2.0 * T), SD, True, T, T, index)
    (clock,) = scanned(errors(4) + lost, fast).jumps
    assert (clock.kind, clock.row) == ("clock", 12)
    assert clock.size / clock.interval == pytest.approx(1.0, abs=3.0 * clock.sd / clock.interval)


def test_several_are_found_and_more_than_a_few_are_a_crowd() -> None:
    index = np.arange(N)
    two = scanned(
        errors(5) + np.where(index >= 8, 15.0 * SD, 0.0) - np.where(index == 17, 20.0 * SD, 0.0)
    )
    assert [(jump.kind, jump.row) for jump in two.jumps] == [("step", 8), ("frame", 17)]
    assert not two.crowd
    many = errors(6)
    many[2:22:2] += 40.0 * SD * np.array([1, -1, -1, 1, 1, -1, 1, 1, -1, -1])
    wild = scanned(many)
    assert len(wild.jumps) <= MOST


def test_where_points_do_not_follow_each_other_only_single_ones_can_be_off() -> None:
    y = errors(1) - np.where(np.arange(N) >= 9, 12.0 * SD, 0.0)
    assert all(jump.kind == "frame" for jump in scanned(y, frames(in_sequence=False)).jumps)


@pytest.mark.statistics
def test_clean_readings_are_hardly_ever_accused() -> None:
    accused = sum(bool(scanned(errors(100 + i)).jumps) for i in range(300))
    assert accused < 15  # 5 %
    # and those with a step of six standard deviations nearly always
    index = np.arange(N)
    assert (
        sum(
            bool(scanned(errors(i) + np.where(index >= 12, 6.0 * SD, 0.0)).jumps) for i in range(50)
        )
        > 40
    )


def with_step(
    folder: Path, size: float, row: int, *, run: str = "", noise: str = DIFFERENTIATED
) -> Campaign:
    """The recording of `test_unmodelled_force` with all positions from `row` on shifted."""
    body(folder, shared=KEY, run=run, noise=noise)
    lines = (folder / "r.csv").read_text().splitlines()
    for i in range(row + 1, len(lines)):
        t, x = lines[i].split(",")
        lines[i] = f"{t},{float(x) + size:.9f}"
    (folder / "r.csv").write_text("\n".join(lines))
    return load_campaign(folder / "c.toml")


@pytest.mark.slow
def test_a_recording_with_a_step_ends_where_the_same_one_without_it_does(tmp_path: Path) -> None:
    clean, spoiled = (nearby(with_step(tmp_path, size, 20)) for size in (0.0, 0.015))
    assert clean.forces[0].bad.jumps == ()
    (jump,) = spoiled.forces[0].bad.jumps
    assert (jump.kind, jump.row, jump.line) == ("step", 20, 22)
    assert jump.size == pytest.approx(0.015, abs=3.0 * jump.sd)
    sds = np.sqrt(np.diag(spoiled.cov))
    assert np.all(np.abs(spoiled.values - clean.values) < 2.0 * sds)
    assert np.all(sds < 2.0 * np.sqrt(np.diag(clean.cov)))
    # a fit that takes every frame at its word is far off
    white = nearby(with_step(tmp_path, 0.015, 20, run="unmodelled_force = 0.0\n"))
    assert np.abs((white.values - clean.values) / np.sqrt(np.diag(clean.cov))).max() > 5.0
    (finding,) = bad_frames_found(spoiled.forces[0])
    words = describe(finding)
    assert "line 22 of its file" in words
    assert "t_max_s = 0.616667 in its window" in words  # differences reach one reading farther
    assert "t_min_s = 0.716667 only what comes after" in words
    assert 'offset_m = "0 +/- 0.03"' in words
    assert "the data are not altered" in words
    assert too_many_bad_frames(spoiled.forces[0]) == ()


def test_rows_that_are_left_out_as_stated_are_gone_and_counted(tmp_path: Path) -> None:
    time = 0.683333
    campaign = with_step(tmp_path, 0.0, 20, run=f"leave_out_s = [{time:.6f}]\n")
    (run,) = campaign.problem(["r"]).runs
    assert "1 excluded by leave_out_s" in [describe(why) for why in run.excluded]
    assert run.t is not None
    assert np.abs(run.t - time).min() > 0.03
    for written, rule in (
        ("[0.65, 77.0]", "the nearest is"),
        ("[0.66]", "on line 21"),
        ('["a"]', "must be a number"),
    ):
        text = (tmp_path / "c.toml").read_text().replace(f"[{time:.6f}]", written)
        (tmp_path / "d.toml").write_text(text)
        with pytest.raises(InputError, match=rf"d\.toml:\d+: '.*' .*{rule}"):
            load_campaign(tmp_path / "d.toml")


@pytest.mark.slow
@pytest.mark.parametrize("counts", [5, -5, -50])
def test_counts_that_a_real_wheels_encoder_loses_are_named_and_its_moment_stays(
    tmp_path: Path, counts: int
) -> None:
    step, row, fits = 2.0 * np.pi / 500.0, 22, []
    text = "\n".join(
        line
        for line in (WHEEL / "campaign.toml").read_text().splitlines()
        if not line.startswith("scatter")
    )
    (tmp_path / "wheel.toml").write_text(
        text.replace('file = "', f'file = "{WHEEL}/').replace(
            f"{WHEEL}/class-balanced_2", "spoiled"
        )
    )
    lines = (WHEEL / "class-balanced_2.csv").read_text().splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("t_s"))
    for lost in (0, counts):
        rows = [line.split(",") for line in lines[head + 1 :]]
        spoiled = [
            f"{t},{float(theta) + (lost * step if i >= row else 0.0):.6f}"
            for i, (t, theta, *_) in enumerate(rows)
        ]
        (tmp_path / "spoiled.csv").write_text("\n".join([*lines[: head + 1], *spoiled]))
        campaign = load_campaign(tmp_path / "wheel.toml")
        fits.append(
            fit_problem(campaign.problem(["class-balanced_2"]), rng=np.random.default_rng(1))
        )
    clean, found = fits
    assert clean.forces[0].bad.jumps == ()
    (jump,) = found.forces[0].bad.jumps
    assert (jump.kind, jump.line) == ("step", head + 2 + row)
    assert abs(jump.row - row) <= 1
    assert jump.size / step == pytest.approx(counts, abs=3.0 * jump.sd / step)
    i = clean.names.index("rolling_resistance")
    assert abs(found.values[i] - clean.values[i]) < 0.7 * np.sqrt(found.cov[i, i])
    words = describe(bad_frames_found(found.forces[0])[0])
    assert "counts of the encoder" in words
    # what is advised cures it on both sides; a window that ends with the last reading before it
    # has speeds that are made of one after it
    last, first = (float(t) for t in re.findall(r"t_m(?:ax|in)_s = ([\d.]+)", words))
    (offset,) = re.findall(r"state (offset_rad = .*?) too", words)
    assert (last, first) == pytest.approx((jump.t - 0.3, jump.t + 0.2))
    ends = {f"t_max_s = {last}": "", f"t_min_s = {first}": offset, f"t_max_s = {last + 0.2}": ""}
    wheel, bad = (tmp_path / "wheel.toml").read_text(), []
    for end, further in ends.items():
        window = f"window = {{theta_min_rad = 0.5, theta_max_rad = 15.0, {end}}}\n{further}"
        (tmp_path / "part.toml").write_text(
            wheel.replace('file = "spoiled.csv"', f'file = "spoiled.csv"\n{window}')
        )
        problem = load_campaign(tmp_path / "part.toml").problem(["class-balanced_2"])
        part = fit_problem(problem, rng=np.random.default_rng(1))
        bad.append(len(part.forces[0].bad.jumps))
        k = part.names.index("rolling_resistance")
        assert abs(part.values[k] - clean.values[i]) < 2.5 * np.sqrt(part.cov[k, k]), end
    assert bad == [0, 0, 1]
