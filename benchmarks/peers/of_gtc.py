"""Examples of GTC 1.5.1: numbers printed in the docstrings of `GTC/type_a.py`, and in the examples of
its documentation (MIT licence), which are those of the GUM.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from cases import example

from estim import Input, fit_curve, fit_line, propagate_linear


@example("GTC", "type_a.line_fit", "a line, errors from the residuals",
         printed={"intercept": ("4.813888889", "4.886206183"), "slope": ("9.408333333", "0.868301648")})  # fmt: skip
def line() -> Any:
    x, y = [1, 2, 3, 4, 5, 6, 7, 8, 9], [15.6, 17.5, 36.6, 43.8, 58.2, 61.6, 64.2, 70.4, 98.8]
    return fit_curve("line", x, y)


@example("GTC", "type_a.line_fit_wls", "a line, stated errors",
         printed={"intercept": ("0.8852320675", "0.5297081435"), "slope": ("2.0569620253", "0.1778920167")})  # fmt: skip
def weighted_line() -> Any:
    x, y, u_y = [1, 2, 3, 4, 5, 6], [3.2, 4.3, 7.6, 8.6, 11.7, 12.8], [0.5, 0.5, 0.5, 1.0, 1.0, 1.0]
    return fit_curve("line", x, y, u_y=u_y)


@example("GTC", "type_a.line_fit_rwls", "a line, errors known but for a common factor",
         printed={"intercept": ("1.14", "0.12"), "slope": ("1.973", "0.041")})  # fmt: skip
def relative_weights() -> Any:
    x, y = [1, 2, 3, 4, 5, 6], [3.014, 5.225, 7.004, 9.061, 11.201, 12.762]
    fit = fit_line(x, y, u_y=[0.2, 0.2, 0.2, 0.4, 0.4, 0.4])
    u = fit.standard_errors["scaled"]
    return {"intercept": (fit.intercept, u.u_intercept), "slope": (fit.slope, u.u_slope)}


YORK_X = [0.0, 0.9, 1.8, 2.6, 3.3, 4.4, 5.2, 6.1, 6.5, 7.4]
YORK_Y = [5.9, 5.4, 4.4, 4.6, 3.5, 3.7, 2.8, 2.8, 2.4, 1.5]
YORK_U_X = np.array([1000, 1000, 500, 800, 200, 80, 60, 20, 1.8, 1.0]) ** -0.5
YORK_U_Y = np.array([1, 1.8, 4, 8, 20, 20, 70, 70, 100, 500]) ** -0.5


@example("GTC", "type_a.line_fit_wtls", "a line, errors of x and y",
         printed={"intercept": ("5.47991018", "0.29193349"), "slope": ("-0.48053339", "0.057616740")},
         spread=0.02, why="estim recommends standard errors that follow from the data alone; York's and GTC's use adjusted points.")  # fmt: skip
def errors_of_x() -> Any:
    fit = fit_line(YORK_X, YORK_Y, u_x=YORK_U_X, u_y=YORK_U_Y)
    u = fit.standard_errors["york"]
    return {"intercept": (fit.intercept, u.u_intercept), "slope": (fit.slope, u.u_slope)}


@example("GTC", "GUM_H3: calibration of a thermometer", "a line and its value far from the points",
         printed={"y_1": ("-0.1712", "0.0029"), "y_2": ("0.00218", "0.00067"), "b30": ("-0.1494", "0.0041")})  # fmt: skip
def thermometer() -> Any:
    t = [21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511]
    b = [-0.171, -0.169, -0.166, -0.159, -0.164, -0.165, -0.156, -0.157, -0.159, -0.161, -0.160]
    return fit_curve("y_1 + y_2*(x - 20)", t, b, derived={"b30": "y_1 + y_2*10"})


@example("GTC", "GUM_H2: resistance and reactance", "a propagation, readings that were taken together",
         printed={"R": ("127.732", "0.071"), "X": ("219.847", "0.295"), "Z": ("254.260", "0.236")})  # fmt: skip
def impedance() -> Any:
    readings = {
        "V": [5.007, 4.994, 5.005, 4.990, 4.999],
        "I": [19.663e-3, 19.639e-3, 19.640e-3, 19.685e-3, 19.678e-3],
        "phi": [1.0456, 1.0438, 1.0468, 1.0428, 1.0433],
    }
    inputs = [
        Input(name, np.mean(r), np.std(r, ddof=1) / np.sqrt(5), dof=4)
        for name, r in readings.items()
    ]
    result = propagate_linear(
        lambda v: np.array([v["V"]/v["I"]*np.cos(v["phi"]), v["V"]/v["I"]*np.sin(v["phi"]), v["V"]/v["I"]]), inputs,
        correlation=np.corrcoef(list(readings.values())),
    )  # fmt: skip
    return dict(zip("RXZ", zip(result.value, result.u, strict=True), strict=True))
