"""Examples of suncal 1.7.1: numbers that its tests (`test/test_examples.py`, with their files) hold it
to, most of them published by NIST.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from cases import example

from estim import Input, propagate_linear, propagate_monte_carlo


@example("suncal", "ex_viscometer.yaml (NIST TN 1900, E3), Monte Carlo", "a propagation, strongly bent",
         printed={"mu": ("5.82", "1.11")}, spread=0.02, slow=True)  # fmt: skip
def viscometer() -> Any:
    inputs = [
        Input("mu_c", 4.63, 0.0463), Input("t_m", 61.0, 6.1), Input("t_c", 36.6, 5.49),
        Input("rho_m", 1180.0, 0.5), Input("rho_c", 810.0, 0.5), Input("rho_b", 2217.0, 0.5),
    ]  # fmt: skip
    draws = propagate_monte_carlo(
        lambda v: v["mu_c"]*v["t_m"]*(v["rho_b"] - v["rho_m"])/(v["t_c"]*(v["rho_b"] - v["rho_c"])), inputs, rng=np.random.default_rng(1)
    )  # fmt: skip
    return {"mu": (float(draws.mean), float(draws.u))}


@example("suncal", "test_NIST6: thermal expansion (ex_expansion.yaml)", "a propagation",
         printed={"alpha": ("1.7266e-5", "1.76e-6")}, spread=0.02)  # fmt: skip
def expansion() -> Any:
    inputs = [
        Input("L0", 1.4999, 0.0001), Input("L1", 1.5021, 0.0002), Input("T0", 288.15, 0.02), Input("T1", 373.1, 0.05)
    ]  # fmt: skip
    result = propagate_linear(
        lambda v: (v["L1"] - v["L0"]) / (v["L0"] * (v["T1"] - v["T0"])), inputs
    )
    return {"alpha": (float(result.value), float(result.u))}


@example("suncal", "test_NIST10: Stefan-Boltzmann constant", "a propagation, numbers of very different size",
         printed={"sigma": ("5.67037e-8", "2.05e-13")})  # fmt: skip
def stefan_boltzmann() -> Any:
    inputs = [
        Input("h", 6.62606957e-34, 0.00000029e-34), Input("R", 8.3144621, 0.0000075), Input("Rinf", 10973731.568539, 0.000055),
        Input("e", 5.4857990946e-4, 0.0000000022e-4), Input("alpha", 7.2973525698e-3, 0.0000000024e-3),
    ]  # fmt: skip
    result = propagate_linear(
        lambda v: 32*np.pi**5*v["h"]*v["R"]**4*v["Rinf"]**4/(15*v["e"]**4*1e-12*299792458.0**6*v["alpha"]**8), inputs
    )  # fmt: skip
    return {"sigma": (float(result.value), float(result.u))}
