"""Small campaigns with one trouble each, and beside each the same without it, written as files.

Every curve is known: positions of a disk from `model.simulate`, or a user's formula, with normal
errors of a fixed seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estim.model import Body
from estim.model.simulate import frame_times, simulate_positions


def uniform(low: float, high: float) -> str:
    return f'{{prior = "uniform", low = {low}, high = {high}}}'


@dataclass(frozen=True)
class Disk:
    """What is said about one run of a disk (TOML values) whose truth is gamma 0.187, kappa 0.45,
    theta0, phi (degrees); its curve is complete.
    """

    gamma: str = '"0.187(10)"'
    kappa: str = uniform(0.0, 1.0)
    phi: str = '"4.0(1)"'
    theta0: str = '"60.0(15)"'
    more: str = ""
    true_phi: float = 4.0
    true_theta0: float = 60.0

    def write(self, folder: Path) -> Path:
        rng = np.random.default_rng(3)
        body = Body(radius=0.15, gamma=0.187, kappa=0.45)
        motion = {
            "phi": float(np.radians(self.true_phi)),
            "theta0": float(np.radians(self.true_theta0)),
            "g": 9.81,
        }
        t = frame_times(body, **motion, interval=1.0 / 30.0, x_end=0.877, rng=rng)
        x = simulate_positions(t, body, **motion, sigma_x=0.001, rng=rng)
        (folder / "r.csv").write_text(
            "t_s,x_m\n" + "".join(f"{a:.6f},{b:.6f}\n" for a, b in zip(t - t[0], x, strict=True))
        )
        text = f"""title = "one run of a disk"
kind = "synthetic"
[shared]
g = 9.81
unmodelled_force = 0
noise = {{sigma_x_m = 0.001}}
{self.more}
[bodies.b]
radius_m = 0.15
gamma = {self.gamma}
kappa = {self.kappa}
[[runs]]
name = "r"
body = "b"
file = "r.csv"
phi_deg = {self.phi}
theta0_deg = {self.theta0}
"""
        (folder / "campaign.toml").write_text(text)
        return folder / "campaign.toml"


@dataclass(frozen=True)
class Formula:
    """A user's own curve through 20 points of `truth` on (0, 2], with normal errors of standard
    deviation `error`.
    """

    expression: str
    parameters: str
    truth: Callable[[np.ndarray], np.ndarray]
    error: float = 0.02
    u_y: str = "0.02"

    def write(self, folder: Path) -> Path:
        x = np.linspace(0.1, 2.0, 20)
        y = self.truth(x) + self.error * np.random.default_rng(2).standard_normal(x.size)
        (folder / "r.csv").write_text(
            "x,y\n" + "".join(f"{a:.6f},{b:.9f}\n" for a, b in zip(x, y, strict=True))
        )
        text = f"""title = "a formula"
kind = "synthetic"
[curve]
expression = "{self.expression}"
x = {{column = "x"}}
y = {{column = "y"}}
u_y = {self.u_y}
[curve.parameters]
{self.parameters}
[[runs]]
name = "r"
file = "r.csv"
"""
        (folder / "campaign.toml").write_text(text)
        return folder / "campaign.toml"


@dataclass(frozen=True)
class Trouble:
    """A campaign, the options of `estim fit`, and what must be said about it; `healthy` is the
    campaign without the trouble.
    """

    campaign: Disk | Formula
    healthy: Disk | Formula
    status: str
    reason: str
    advice: str
    options: tuple[str, ...] = ()


FREE = {"gamma": uniform(0.05, 0.4), "kappa": uniform(0.0, 2.0), "phi": "4.0"}
DOWN = {"phi": '"-5.5(1)"', "theta0": '"20.0(15)"', "true_phi": -5.5, "true_theta0": 20.0}
LINE = "a = {start = 1.0}\nb = {start = 1.0}"
SIGMA = '{{prior = "half-normal", scale = {}}}'

TROUBLES = {
    # sampling is cut off
    "chain too short": Trouble(
        Disk(),
        Disk(),
        "not-converged",
        r"sampling stopped after 60 steps although",
        "increase the number of steps (--max-steps)",
        ("--max-steps", "60"),
    ),
    # the "measurements" were computed from the curve: the density rises without limit as the
    # inferred sigma goes to 0
    "computed data": Trouble(
        Formula("a + b*x", LINE, lambda x: 1.0 + 2.0 * x, error=0.0, u_y=SIGMA.format(1e-5)),
        Formula("a + b*x", LINE, lambda x: 1.0 + 2.0 * x, u_y=SIGMA.format(0.1)),
        "not-converged",
        r"all residuals are zero .* were the data computed\?",
        "look at the trace plots",
        ("--max-steps", "60"),
    ),
    # the true gamma, 0.187, lies beyond what was thought possible; a little beyond (0.185) it is a
    # limit and no trouble
    "gamma at its bound": Trouble(
        Disk(gamma=uniform(0.0, 0.175)),
        Disk(gamma=uniform(0.0, 0.185)),
        "at-bound",
        r"γ\[b\] lies at the edge of its prior, 0\.175, and the data favour values beyond "
        r"it \(p = 0\.0051\)$",
        "widen the prior",
    ),
    # (gamma, s, 1 + j) scaled together leave the speed unchanged, and nothing says how large one of
    # them is
    "flat direction": Trouble(
        Disk(**FREE, more=f"rolling_resistance = {uniform(0.0, 0.1)}"),
        Disk(**FREE, more="rolling_resistance = 0.0"),
        "not-identified",
        r"c_rr up by .* together do not change the predicted data at all",
        "a uniform range does not count",
    ),
    # the first centimetres give the acceleration alone, which two angles of release share
    "two angles of release": Trouble(
        Disk(
            "0.187", "0.45", "4.0", uniform(10.0, 170.0), "window = {x_min_m = 0.0, x_max_m = 0.05}"
        ),
        Disk("0.187", "0.45", "4.0", uniform(10.0, 170.0)),
        "multimodal",
        r"2 separate solutions: θ₀\[r\] = 12\d\.\d ° \(.* of the posterior\); or θ₀\[r\] = "
        r"(59|60)\.\d+ °",
        "a range that contains one of them",
    ),
    "two signs": Trouble(
        Formula("a**2*x", f"a = {uniform(-3.0, 3.0)}", lambda x: 4.0 * x),
        Formula("a**2*x", f"a = {uniform(0.0, 3.0)}", lambda x: 4.0 * x),
        "multimodal",
        r"a = -?2 \((4[5-9]|5[0-5]) % of the posterior\); or a = -?2 \((4[5-9]|5[0-5]) %",
        "a range that contains one of them",
    ),
    # the ramp stands at 4 degrees
    "wrong tilt": Trouble(
        Disk(phi='"40.0(4)"'),
        Disk(),
        "contradiction",
        r"φ\[r\] was stated as 40 °, [78]\d\.\d standard deviations above",
        "check the stated value",
    ),
    # a balanced wheel is assumed, an unbalanced one rolled down
    "wrong model": Trouble(
        Disk(gamma="0.0", **DOWN),
        Disk(**DOWN),
        "poor-fit",
        "neighbouring points lie off the curve by similar amounts",
        "an effect that the curve does not model",
    ),
}
