"""Examples of scipy.odr, whose numbers stand in its tests (`scipy/odr/tests/test_odr.py`, BSD licence;
ODRPACK's guide and a student's experiment).
"""

from __future__ import annotations

from typing import Any

from cases import example

from estim import fit_curve, fit_line

PEARSON_U_X = [0.03, 0.03, 0.04, 0.035, 0.07, 0.11, 0.13, 0.22, 0.74, 1.0]
PEARSON_U_Y = [1.0, 0.74, 0.5, 0.35, 0.22, 0.22, 0.12, 0.12, 0.1, 0.04]


@example("scipy", "odr, test_pearson", "a line, errors of x and y known but for a common factor",
         printed={"intercept": ("5.4767400299", "0.3590121691"), "slope": ("-0.4796082368", "0.0706291186")}, spread=0.01)  # fmt: skip
def pearson() -> Any:
    x = [0.0, 0.9, 1.8, 2.6, 3.3, 4.4, 5.2, 6.1, 6.5, 7.4]
    y = [5.9, 5.4, 4.4, 4.6, 3.5, 3.7, 2.8, 2.8, 2.4, 1.5]
    fit = fit_line(x, y, u_x=PEARSON_U_X, u_y=PEARSON_U_Y)
    u = fit.standard_errors["scaled"]
    return {"intercept": (fit.intercept, u.u_intercept), "slope": (fit.slope, u.u_slope)}


@example("scipy", "odr, test_lorentz", "a resonance, errors of x and y",
         printed={"A": ("1430.6780846", "0.49713"), "width": ("0.13390509", "0.00023681"), "x_0": ("3.77981936", "0.00016511")},
         within=1.0, spread=0.2, why="The standard deviations printed here are those of scipy's `cov_beta`: its `sd_beta` are larger by 1.48, "
         "for it scales them by the residuals. estim says `poor-fit` instead, and integrates the true abscissas out.")  # fmt: skip
def lorentz() -> Any:
    x = [3.9094, 3.85945, 3.84976, 3.84716, 3.84551, 3.83964, 3.82608, 3.78847, 3.78163, 3.72558, 3.70274,
         3.6973, 3.67373, 3.65982, 3.6562, 3.62498, 3.55525, 3.41886]  # fmt: skip
    y = [
        652,
        910.5,
        984,
        1000,
        1007.5,
        1053,
        1160.5,
        1409.5,
        1430,
        1122,
        957.5,
        920,
        777.5,
        709.5,
        698,
        578.5,
        418.5,
        275.5,
    ]
    u_x = [0.000972971, 0.000948268, 0.000707632, 0.000706679, 0.000706074, 0.000703918, 0.000698955, 0.000456856,
           0.000455207, 0.000662717, 0.000654619, 0.000652694, 8.59202e-7, 0.00106589, 0.00106378, 0.00125483,
           0.00140818, 0.00241839]  # fmt: skip
    return fit_curve(
        "A*width*x_0/sqrt((x**2 - x_0**2)**2 + (width*x)**2)", x, y, u_x=u_x, u_y=0.29,
        start={"A": 1000, "width": 0.1, "x_0": 3.8}, bounds={"width": (0, None), "x_0": (0, None)},
    )  # fmt: skip
