"""Results for other programs: what ArviZ, xarray, pandas and notebooks get is what the analysis
holds.
"""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner, Result
from command_runner import runner
from replica_run import heavy_04
from troubles import Formula

import estim
from estim.checks.cross_validation import leave_one_out
from estim.cli.commands import cli
from estim.common.errors import InputError
from estim.common.statuses import Finding, Kind, Status
from estim.pipeline import Analysis
from estim.reports import interop
from estim.sampling.chain import Target
from estim.sampling.diagnostics import mixing_of
from estim.words import advice, describe

NEEDED = "needs the extra arviz"


@pytest.fixture
def campaign() -> estim.Campaign:
    return heavy_04()[0]


@pytest.fixture
def analysis() -> Analysis:
    return heavy_04()[1]


@pytest.fixture(scope="module")
def own_curve() -> Analysis:
    x = np.linspace(0.0, 1.0, 12)
    y = 1.0 + 2.0 * x + 0.1 * np.random.default_rng(3).standard_normal(x.size)
    fit = estim.fit_curve(
        "a + b*x", x, y, u_y=0.1, start={"a": 0.0, "b": 1.0}, priors={"a": "1.0(5)"}
    )
    return estim.sample_curve(fit, seed=1, target=Target(ess=500))


@pytest.fixture
def xarray() -> object:
    pytest.importorskip("h5netcdf", reason=NEEDED)
    pytest.importorskip("h5py", reason=NEEDED)
    return pytest.importorskip("xarray", reason=NEEDED)


WRONG = Finding(Kind.SINGULAR)


def rejected(analysis: Analysis, status: str, *findings: Finding) -> Analysis:
    diagnosis = replace(analysis.diagnosis, status=Status(status), findings=findings or (WRONG,))
    return replace(analysis, diagnosis=diagnosis)


# --- order of draws


@pytest.mark.parametrize(("n_step", "n_walker"), [(6, 2), (7, 2), (7, 3), (5, 1), (6, 3)])
def test_halves_of_a_chain_are_its_halves_in_time_and_walkers_stay_together(
    n_step: int, n_walker: int
) -> None:
    order = interop.time_halves_order(n_step, n_walker)
    n_half = n_step * n_walker // 2
    assert sorted(order) == list(range(n_step * n_walker))
    assert set(order[:n_half]) == set(range(n_half))
    for half in (order[:n_half], order[-n_half:]):
        step, walker = np.divmod(half, n_walker)
        assert list(zip(walker, step, strict=True)) == sorted(zip(walker, step, strict=True))


def test_order_keeps_our_r_hat_and_effective_sizes_and_the_order_in_time_does_not(
    analysis: Analysis,
) -> None:
    from arviz_stats.base import array_stats

    draws = analysis.chain.draws
    draws = draws[:, draws.shape[1] % 2 :]
    flat = draws.reshape(draws.shape[0], -1, draws.shape[-1])
    ordered = flat[:, interop.time_halves_order(*draws.shape[1:3])]

    def sizes(d: np.ndarray) -> np.ndarray:
        return np.array(
            [
                array_stats.ess(d[..., i], chain_axis=0, draw_axis=1, method="bulk")
                for i in range(d.shape[-1])
            ],
            dtype=float,
        )

    hats = [
        float(array_stats.rhat(ordered[..., i], chain_axis=0, draw_axis=1))
        for i in range(draws.shape[-1])
    ]
    np.testing.assert_allclose(hats, mixing_of(draws).rhat, rtol=1e-9)
    ratio = sizes(ordered) / mixing_of(draws).ess_bulk
    assert np.all(np.abs(ratio - 1.0) < 0.25), ratio  # 15 % off at most in five tries
    # step by step: every draw passes for an independent one
    assert np.all(sizes(flat) > 1.6 * mixing_of(draws).ess_bulk)


# --- DataTree and netCDF


@pytest.mark.slow
def test_netcdf_and_back_gives_equal_numbers(analysis: Analysis, xarray: SimpleNamespace) -> None:
    with xarray.open_datatree(io.BytesIO(estim.to_netcdf(analysis)), engine="h5netcdf") as back:
        back.load()
        tree = estim.to_datatree(analysis)
        xarray.testing.assert_identical(back["posterior"].dataset, tree["posterior"].dataset)
        assert tree.equals(back)
        posterior = back["posterior"].dataset
        for i, name in enumerate(analysis.chain.names):
            stored = analysis.chain.draws[
                :, posterior["step"].values, posterior["walker"].values, i
            ]
            np.testing.assert_array_equal(posterior[name].values, stored)
        stored = analysis.chain.log_density[:, posterior["step"].values, posterior["walker"].values]
        np.testing.assert_array_equal(back["sample_stats"]["lp"].values, stored)
        assert back["posterior"]["phi[heavy-04]"].attrs["units"] == "rad"
        assert back.attrs["kind"] == "SYNTHETIC"
        assert (back.attrs["status"], back.attrs["seed"]) == ("ok", 1)
        assert back.attrs["version_emcee"]


def test_same_analysis_gives_the_same_tree_and_another_seed_other_draws_of_the_prior(
    analysis: Analysis, xarray: SimpleNamespace
) -> None:
    tree = estim.to_datatree(analysis)
    assert tree.identical(estim.to_datatree(analysis))
    assert not tree["prior"].equals(estim.to_datatree(replace(analysis, seed=2))["prior"])


def test_log_likelihood_belongs_to_the_draws_it_stands_beside(
    analysis: Analysis, xarray: SimpleNamespace
) -> None:
    tree = estim.to_datatree(analysis)
    terms = tree["log_likelihood"]["heavy-04"]
    chosen = terms["draw"].values[[0, 7, -1]]
    posterior = tree["posterior"].dataset.sel(draw=chosen)
    draws = np.stack([posterior[name].values for name in analysis.chain.names], axis=-1).reshape(
        -1, len(analysis.chain.names)
    )
    (again,) = analysis.fit.posterior.pointwise(draws)
    np.testing.assert_allclose(
        terms.sel(draw=chosen).values.reshape(again.shape), again, rtol=1e-12
    )
    assert terms.sizes["chain"] * terms.sizes["draw"] <= 2000


def test_data_of_the_tree_are_those_that_were_fit(
    campaign: estim.Campaign, analysis: Analysis, xarray: SimpleNamespace
) -> None:
    tree = estim.to_datatree(analysis)
    run = campaign.problem(["heavy-04"]).runs[0]
    np.testing.assert_array_equal(tree["observed_data"]["heavy-04"].values, run.y)
    np.testing.assert_array_equal(tree["constant_data"]["x[heavy-04]"].values, run.x)
    np.testing.assert_array_equal(tree["constant_data"]["t[heavy-04]"].values, run.t)
    assert tree["observed_data"]["heavy-04"].attrs["units"] == "m/s"


def test_prior_draws_follow_the_stated_values_and_improper_priors_have_none(
    analysis: Analysis, own_curve: Analysis, xarray: SimpleNamespace
) -> None:
    phi = estim.to_datatree(analysis)["prior"]["phi[heavy-04]"].values  # stated: 3.6(4) degrees
    stated = next(p.prior for p in analysis.problem.parameters if p.name == "phi[heavy-04]")
    assert abs(phi.mean() - stated.centre) < 4.0 * stated.sd / np.sqrt(phi.size)
    assert abs(phi.std() / stated.sd - 1.0) < 4.0 / np.sqrt(2.0 * phi.size)
    prior = estim.to_datatree(own_curve)["prior"]
    assert set(prior.data_vars) == {"a"}
    assert prior.attrs["improper"] == "b"


@pytest.mark.slow
def test_arviz_summary_and_loo_agree_with_ours(analysis: Analysis, xarray: SimpleNamespace) -> None:
    arviz_stats = pytest.importorskip("arviz_stats")
    if not hasattr(arviz_stats, "summary"):
        pytest.skip("this arviz-stats lacks its xarray half")
    tree = estim.to_datatree(analysis)
    table = arviz_stats.summary(tree, round_to="none")
    draws = analysis.chain.flat
    np.testing.assert_allclose(
        table["mean"].loc[list(analysis.chain.names)].astype(float), draws.mean(axis=0), rtol=1e-9
    )
    np.testing.assert_allclose(
        table["sd"].loc[list(analysis.chain.names)].astype(float),
        draws.std(axis=0, ddof=1),
        rtol=1e-3,
    )
    theirs, ours = arviz_stats.loo(tree), leave_one_out(analysis.fit.posterior, draws)
    assert abs(theirs.elpd - ours.elpd) < 0.1 * ours.se  # 2000 of the draws against all
    assert abs(theirs.p - ours.p_loo) < 0.1 * ours.se


@pytest.mark.slow
def test_joint_runs_stand_side_by_side(campaign: estim.Campaign, xarray: SimpleNamespace) -> None:
    joint = estim.analyse(
        campaign,
        ["heavy-04", "heavy-06"],
        seed=1,
        target=Target(max_step=60, n_walker=24),
        complete="two runs",
        marginal=False,
    )
    tree = estim.to_datatree(joint)
    assert tree.attrs["status"] == "not-converged"
    assert "sampling stopped" in tree.attrs["reasons"]
    assert (
        set(tree["log_likelihood"].data_vars)
        == set(tree["observed_data"].data_vars)
        == {"heavy-04", "heavy-06"}
    )
    with xarray.open_datatree(io.BytesIO(estim.to_netcdf(joint)), engine="h5netcdf") as back:
        assert tree.equals(back.load())


# --- pandas


def test_frame_holds_the_draws_and_corner_draws_it(analysis: Analysis) -> None:
    pytest.importorskip("pandas", reason="needs pandas")
    import matplotlib.pyplot as plt
    from corner import corner

    frame = estim.to_frame(analysis)
    assert list(frame.columns) == list(analysis.chain.names)
    assert frame.index.names == ["ensemble", "step", "walker"]
    np.testing.assert_array_equal(frame.loc[(2, 5, 7)].to_numpy(), analysis.chain.draws[2, 5, 7])
    assert frame.attrs["units"]["radius"] == "m"
    assert frame.attrs["kind"] == "SYNTHETIC"
    plt.switch_backend("agg")
    figure = corner(frame[["gamma[heavy]", "kappa[heavy]"]].iloc[::20])
    assert len(figure.axes) == 4
    plt.close(figure)


def test_summary_frame_is_the_result_and_has_no_number_that_the_status_forbids(
    campaign: estim.Campaign, analysis: Analysis
) -> None:
    pytest.importorskip("pandas", reason="needs pandas")
    result = estim.result_of(campaign, analysis)
    frame = estim.summary_frame(result)
    assert frame.loc["gamma[heavy]", "mean"] == result.parameters["gamma[heavy]"].mean
    assert frame.loc["gamma[heavy]", "unit"] == "1"
    bad = estim.summary_frame(estim.result_of(campaign, rejected(analysis, "not-converged")))
    assert bad[["mean", "sd", "median", "q025", "q975"]].isna().all(axis=None)
    assert bad.attrs["status"] == "not-converged"


# --- where a package is missing


@pytest.mark.parametrize(
    ("verb", "package", "command"),
    [
        (interop.to_datatree, "xarray", 'pip install "estim[arviz]"'),
        (interop.to_netcdf, "h5netcdf", 'pip install "estim[arviz]"'),
        (interop.to_frame, "pandas", 'pip install "estim[arviz]"'),
    ],
)
def test_missing_package_is_one_line_with_the_command_to_get_it(
    verb: object, package: str, command: str, analysis: Analysis, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interop, "find_spec", lambda name: None if name == package else True)
    with pytest.raises(InputError, match=re.escape(f"'{package}' is not installed: {command}")):
        verb(analysis)
    assert interop.can_write_netcdf() == (package == "pandas")


def run_fit(campaign: Path, out: Path, *more: str) -> Result:
    return runner().invoke(
        cli, ["fit", str(campaign), *more, "--max-steps", "60", "--out", str(out)]
    )


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_fit_writes_the_draws_beside_the_report(
    tmp_path: Path, replica: Path, xarray: SimpleNamespace
) -> None:
    done = run_fit(replica / "campaign.toml", tmp_path, "--run", "heavy-04")
    assert (done.exit_code, done.stderr) == (3, "")
    assert "draws.nc" not in done.stdout
    with xarray.open_datatree(tmp_path / "draws.nc", engine="h5netcdf") as tree:
        assert tree.attrs["status"] == "not-converged"
        assert tree["posterior"]["gamma[heavy]"].sizes["chain"] == 4
    assert not list(tmp_path.rglob(".draws*"))


@pytest.mark.usefixtures("undrawn")
def test_fit_without_the_extra_says_how_to_get_it_and_that_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("estim.reports.interop.can_write_netcdf", lambda: False)
    line = Formula(
        "a + b*x", "a = {start = 1.0}\nb = {start = 1.0}", lambda x: 1.0 + 2.0 * x
    ).write(tmp_path)
    done = run_fit(line, tmp_path / "out")
    assert (done.exit_code, done.stderr) == (3, "")
    unwritten = "draws.nc (the draws, for ArviZ and xarray) was not written"
    assert done.stdout.splitlines()[-1] == f'{unwritten}: pip install "estim[arviz]"'
    assert (tmp_path / "out" / "report.md").exists()
    assert not list(tmp_path.rglob("draws.nc"))


# --- notebooks


def test_notebook_shows_the_values_that_the_report_has(
    campaign: estim.Campaign, analysis: Analysis
) -> None:
    from estim.sampling import value_cell

    result = estim.result_of(campaign, analysis)
    for shown in (analysis._repr_markdown_(), result._repr_markdown_(), str(analysis), str(result)):
        assert "**ok**" in shown or ": ok" in shown
        table, _, left = shown.partition("ot measured here: ")
        for name, p in result.parameters.items():
            row, symbol = value_cell(p, result.labels.parameters[name]), name.partition("[")[0]
            assert (row in table) == (symbol in ("kappa", "phi")), name
            assert (row in left) == (symbol in ("gamma", "theta0", "radius")), name
        assert "c_rr < 0.01" in left
    assert "SYNTHETIC" in analysis._repr_markdown_()
    assert re.search(r"true 0\.45 \(\+[01]\.\d sd\)", str(result))


@pytest.mark.parametrize("status", [status for status in Status if not status.ok])
def test_notebook_shows_reasons_and_no_number_where_the_status_is_not_ok(
    campaign: estim.Campaign, analysis: Analysis, status: str
) -> None:
    bad = rejected(analysis, status)
    for shown in (bad._repr_markdown_(), estim.result_of(campaign, bad)._repr_markdown_()):
        assert f"**{status}**" in shown
        assert f"- {describe(WRONG)}" in shown
        assert f"- What to do: {advice(WRONG)}" in shown
        body = shown.replace("heavy-04", "").replace("1403.7220", "")
        assert not re.search(r"\d", body), body
        assert re.search(r"\d\.\d", analysis._repr_markdown_().replace("1403.7220", ""))


def test_notebook_calls_best_values_no_result(campaign: estim.Campaign, analysis: Analysis) -> None:
    wrong = Finding(Kind.CHI2_TOO_LARGE, p=1e-9, size=9.0, numbers={"dof": 3.0})
    bad = rejected(analysis, "poor-fit", wrong)
    result = estim.result_of(campaign, bad)._repr_markdown_()
    assert re.search(r"^- best values, not a result: .*κ = 0\.\d+", result, re.MULTILINE), result
    for shown in (bad._repr_markdown_(), result):
        assert not re.search(r"±|\[\d|95 %|68 %", shown), shown


@pytest.mark.parametrize("kind", [Kind.SINGULAR, Kind.DIRECTION_FLAT, Kind.UNDETERMINED])
def test_no_best_values_where_others_are_as_good(
    campaign: estim.Campaign, analysis: Analysis, kind: Kind
) -> None:
    poor = Finding(Kind.CHI2_TOO_LARGE, p=1e-9, size=9.0, numbers={"dof": 3.0})
    bad = rejected(analysis, "poor-fit", poor, Finding(kind, names=("a", "b")))
    assert "best values" not in estim.result_of(campaign, bad)._repr_markdown_()


def test_notebook_shows_campaigns_and_own_curves(
    campaign: estim.Campaign, own_curve: Analysis
) -> None:
    shown = campaign._repr_markdown_()
    assert "SYNTHETIC" in shown
    assert all(f"| {name} |" in shown for name in campaign.run_names)
    assert "| heavy-04 | heavy | runs/heavy-04.csv | 35 |" in shown
    assert "| b, parameter of the curve |" in own_curve._repr_markdown_()


def test_notebook_shows_lines(campaign: estim.Campaign) -> None:
    x = np.arange(5.0)
    exact = estim.fit_line(
        x, 1.0 + 2.0 * x + np.array([0.1, -0.1, 0.0, -0.1, 0.1]), u_x=0.1, u_y=0.1
    )
    shown = exact._repr_markdown_()
    error = exact.standard_errors["propagated"]
    assert f"{exact.slope:.2f} ± {error.u_slope:.2f}" in shown
    assert "| **propagated** |" in shown
    assert "Poor fit" in estim.fit_line(x, x**3, u_x=0.1, u_y=0.1)._repr_markdown_()
    vertical = estim.fit_line(np.zeros(5), x, u_x=0.1, u_y=0.1)._repr_markdown_()
    assert "vertical" in vertical
    assert "n/a" in vertical
    series = estim.read_theta_min(campaign.source)
    analysis = estim.analyse_line(series, gamma_masses=None, seed=1, target=Target(ess=500))
    assert "θ_min line" in analysis._repr_markdown_()
    assert (analysis.status == "ok") == (
        "| gamma |" in analysis._repr_markdown_().replace("γ", "gamma")
    )


def test_markdown_survives_a_bar_in_a_name() -> None:
    from estim.common.labels import table

    assert table(("a",), [("x|y",)]).splitlines()[-1] == "| x\\|y |"


# --- the page


@pytest.mark.slow
def test_the_code_of_the_page_runs(
    project: Path,
    xarray: SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    import arviz_stats
    import matplotlib.pyplot as plt

    if not hasattr(arviz_stats, "summary"):
        pytest.skip("this arviz-stats lacks its xarray half")
    page = (project / "docs" / "interop.md").read_text()
    (example,) = re.findall(r"```python\n(.*?)```", page, flags=re.S)
    monkeypatch.chdir(project)
    plt.switch_backend("agg")
    names: dict[str, object] = {}
    exec(compile(example, "interop.md", "exec"), names)
    plt.close("all")
    assert capsys.readouterr().out.startswith("SYNTHETIC ok\n")
    back = eval(
        re.search(r"`tree(\[\"posterior\"\]\.dataset\.set_index.*?)`", page)[0].strip("`"), names
    )
    analysis = names["analysis"]
    radius = analysis.chain.draws[..., analysis.fit.names.index("radius")]
    np.testing.assert_array_equal(
        back["radius"].transpose("chain", "step", "walker").values, radius
    )


@pytest.mark.usefixtures("undrawn")
def test_names_of_coordinates_and_marks_that_do_not_print(tmp_path: Path) -> None:
    """A parameter called chain, a run called draw, a title with a null character: HDF5 and xarray
    take none of them as they are.
    """
    pytest.importorskip("h5netcdf")
    xarray = pytest.importorskip("xarray")
    (tmp_path / "r.csv").write_text(
        "x,y\n"
        + "".join(f"{0.1 * n:.1f},{1 + 0.2 * n + 0.01 * (-1) ** n:.3f}\n" for n in range(12))
    )
    (tmp_path / "c.toml").write_text(
        'title = "a\\u0000b"\nkind = "measured"\n[curve]\nexpression = "chain + '
        'print*x"\nx = "x"\ny = "y"\nu_y = 0.01\n[curve.parameters]\n'
        'chain = {start = 1.0}\nprint = {start = 1.0}\n[[runs]]\nname = "draw"\nfile = "r.csv"\n'
    )
    done = CliRunner().invoke(
        cli, ["fit", str(tmp_path / "c.toml"), "--out", str(tmp_path / "out"), "--max-steps", "60"]
    )
    assert done.exit_code == 3, done.output
    with xarray.open_datatree(tmp_path / "out" / "draws.nc") as tree:
        assert set(tree["posterior"].data_vars) == {"parameter chain", "print"}
        assert set(tree["log_likelihood"].data_vars) == {"run draw"}
        assert tree.attrs["title"] == "a\\x00b"
