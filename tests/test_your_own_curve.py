"""What docs/your-own-curve.md shows is run as it stands."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from estim import fit_curve


def blocks(project: Path, language: str) -> list[str]:
    return re.findall(
        rf"```{language}\n(.*?)```",
        (project / "docs" / "your-own-curve.md").read_text(),
        flags=re.S,
    )


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_code_of_the_page_runs(
    project: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks(project, "python"):
        exec(compile(block, "your-own-curve.md", "exec"), names)
    fit, cup = names["fit"], names["cup"]
    assert fit.status == cup.status == "ok"
    assert abs(fit.values["T"] - 1.53) < 4 * fit.sds["T"]
    assert abs(cup.values["tau"] - 18.0) < 4 * cup.sds["tau"]
    assert cup.sds["room"] > 0.5
    refused, honest = names["refused"], names["honest"]
    assert (refused.status, honest.status) == ("poor-fit", "ok")
    assert "another curve" in refused.advice[0]
    assert abs(honest.values["g"] - 9.81) < 2.0 * honest.sds["g"]
    misled = names["misled"]
    assert misled.status == "ok"
    assert misled.values["g"] < 9.81 - 4.0 * misled.sds["g"]
    page = (project / "docs" / "your-own-curve.md").read_text()
    for fit in (honest, misled):
        assert f"g = {fit.values['g']:.2f} ± {fit.sds['g']:.2f} m/s²" in page
    assert f"{refused.values['g']:.2f} ± {refused.sds['g']:.2f}" in page
    for name, true in (
        ("pendulum", {"angle0": 0.5 * math.pi, "T0": 2.1}),
        ("spot", {"u_0": 0.5, "v_0": -0.3}),
        ("resonance", {"f_0": 10.1, "Q": 12}),
    ):
        fit = names[name]
        assert fit.status == "ok"
        assert all(abs(fit.values[p] - value) < 4.0 * fit.sds[p] for p, value in true.items())
    assert capsys.readouterr().out.endswith("ok\n")
    assert "turning point" not in (tmp_path / "tea" / "report.md").read_text()


def test_the_campaign_of_the_page_is_read(project: Path, tmp_path: Path) -> None:
    from estim.campaign import load_campaign

    text, varying = blocks(project, "toml")
    (tmp_path / "campaign.toml").write_text(text)
    t = np.arange(0.0, 12.0, 0.1)
    for name in ("first", "second"):
        np.savetxt(
            tmp_path / f"{name}.csv",
            np.column_stack([t, np.cos(t)]),
            delimiter=",",
            header="t_s,angle_deg",
            comments="",
        )
    problem = load_campaign(tmp_path / "campaign.toml").problem(["first", "second"])
    assert set(problem.names) == {
        "A[first]",
        "b",
        "T",
        "p[first]",
        "c",
        "A[second]",
        "p[second]",
        "scale_x",
    }
    part, whole = (
        tomllib.loads(toml)
        for toml in (varying, (project / "data" / "gallery" / "michelson.toml").read_text())
    )
    assert part["curve"]["expression"] == whole["curve"]["expression"]
    assert {
        key: part["runs"][0]["parameters"]["z"][key] for key in ("prior", "mean", "sd")
    }.items() <= whole["runs"][0]["parameters"]["z"].items()


def test_the_page_names_every_function(project: Path) -> None:
    from estim.curves.formula import FUNCTIONS

    text = (
        (project / "docs" / "your-own-curve.md")
        .read_text()
        .partition("## What a formula may hold")[2]
    )
    assert set(FUNCTIONS) <= set(re.findall(r"\w+", text))


@pytest.mark.slow
def test_a_function_of_numbered_points_fits_complex_values_and_a_wrong_circuit_is_poor() -> None:
    rng, w = np.random.default_rng(5), np.linspace(1.0, 20.0, 40)
    noise = rng.normal(0.0, 0.3, 40) + 1j * rng.normal(0.0, 0.3, 40)
    measured = 10.0 + 2.0j * w + 1.0 / (0.01j * w) + noise

    def below_each_other(impedance: np.ndarray, point: np.ndarray) -> np.ndarray:
        k = np.clip(np.rint(np.real(point)).astype(int), 0, 2 * w.size - 1)
        return np.concatenate([impedance.real, impedance.imag])[k]

    def series(point, r=5.0, coil=1.0, c=0.02):
        return below_each_other(r + 1j * w * coil + 1.0 / (1j * w * c), point)

    def without_coil(point, r=5.0, c=0.02):
        return below_each_other(r + 1.0 / (1j * w * c), point)

    y = np.concatenate([measured.real, measured.imag])
    fit = fit_curve(series, np.arange(80), y, u_y=0.3)
    assert fit.status == "ok"
    # real parts know r alone, imaginary ones coil and 1/c, which are linear: the textbook's squares
    assert abs(fit.values["r"] - measured.real.mean()) < 1e-4
    assert fit.sds["r"] == pytest.approx(0.3 / np.sqrt(40.0), rel=1e-4)
    linear, cov = np.polyfit(w**2, measured.imag * w, 1, w=1.0 / w, cov="unscaled")
    assert abs(fit.values["coil"] - linear[0]) < 0.01 * fit.sds["coil"]
    assert fit.sds["coil"] == pytest.approx(0.3 * np.sqrt(cov[0, 0]), rel=1e-3)
    assert fit_curve(without_coil, np.arange(80), y, u_y=0.3).status == "poor-fit"
