"""Examples of suncal 1.7.1: numbers that its tests (`test/test_examples.py`, with their files) hold it
to, most of them published by NIST.
"""

from __future__ import annotations

from typing import Any

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
        lambda v: v["mu_c"]*v["t_m"]*(v["rho_b"] - v["rho_m"])/(v["t_c"]*(v["rho_b"] - v["rho_c"])), inputs
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
