"""The rolling body and the symbols of its theory.

| symbol | name in code | unit | meaning |
|---|---|---|---|
| R | radius | m | radius of the disk |
| M_D, M_P | mass_disk, mass_particle | kg | disk; particle |
| M_T | mass_trailing | kg | part that translates with the axle and does not rotate |
| M | mass | kg | M_D + M_P + M_T |
| rho | rho | 1 | distance of the particle from the axle / R (1 in the paper) |
| gamma | gamma | 1 | distance of the centre of mass from the axle / R = (M_P/M) rho |
| kappa | kappa | 1 | I_C/(M_D R^2): inertia of the disk alone, about the axle |
| tau | trailing_fraction | 1 | M_T/M |
| k_P | particle_gyration | 1 | radius of gyration of the particle about its own centre / R |
| j | inertia_ratio | 1 | inertia of all that rotates, about the axle, / (M R^2) |
| phi | phi | rad | tilt of the ramp, positive when x points uphill |
| theta, theta0 | theta, theta0 | rad | angle of the particle from the vertical, and at release |
| c_rr | rolling_resistance | 1 | coefficient of rolling resistance |
| s | slope | 1 | effective slope sin(phi) + c_rr cos(phi) |

theta = theta0 + x/R.

Use `Body(...)` when the ratios are known and `Body.from_masses(...)` when the parts were weighed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# A quantity is a float, an array that broadcasts, or anything with arithmetic (a ufloat of the
# uncertainties package).
Quantity = Any


@dataclass(frozen=True, eq=False)
class Body:
    """A disk with an off-axis particle and, if need be, a trailing mass that does not rotate.

    Every field is a number, an array shaped (n_draw, 1) for vectorised use over draws, or a ufloat;
    nothing is converted, so uncertainties pass through.  `mass` (kg) is None where only the motion
    is wanted: forces and energies in newton and joule need it.

    radius : R, m.  gamma : distance of the centre of mass from the axle / R.
    kappa : inertia of the disk alone / (M_D R^2).  rho : distance of the particle / R.
    trailing_fraction : share of the mass that does not rotate.
    particle_gyration : radius of gyration of the particle about its own centre / R.

    >>> from estim.model import Body
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> body.rho, body.mass
    (1.0, None)
    """

    radius: Quantity
    gamma: Quantity
    kappa: Quantity
    rho: Quantity = 1.0
    trailing_fraction: Quantity = 0.0
    particle_gyration: Quantity = 0.0
    mass: Quantity | None = None

    @classmethod
    def from_masses(
        cls,
        radius: Quantity,
        mass_disk: Quantity,
        mass_particle: Quantity,
        *,
        kappa: Quantity,
        rho: Quantity = 1.0,
        mass_trailing: Quantity = 0.0,
        particle_gyration: Quantity = 0.0,
    ) -> Body:
        """The body whose parts weigh `mass_disk`, `mass_particle`, `mass_trailing` (kg).

        gamma = (M_P/M) rho,  M = M_D + M_P + M_T      (paper, eq. gamma, with rho = 1 and M_T = 0)
        """
        mass = mass_disk + mass_particle + mass_trailing
        return cls(
            radius=radius,
            gamma=mass_particle * rho / mass,
            kappa=kappa,
            rho=rho,
            trailing_fraction=mass_trailing / mass,
            particle_gyration=particle_gyration,
            mass=mass,
        )

    @property
    def inertia_ratio(self) -> Quantity:
        """j = kappa M_D/M + (M_P/M)(rho^2 + k_P^2), dimensionless; (1 - gamma) kappa + gamma in the
        paper.
        """
        particle = self.gamma / self.rho
        return self.kappa * (1.0 - particle - self.trailing_fraction) + particle * (
            self.rho**2 + self.particle_gyration**2
        )

    def inertia_ratio_gradient(self) -> dict[str, Quantity]:
        """Derivatives of j with respect to the fields it depends on: name -> dj/dfield,
        dimensionless.
        """
        gamma, kappa, rho = self.gamma, self.kappa, self.rho
        return {
            "gamma": (rho**2 + self.particle_gyration**2 - kappa) / rho,
            "kappa": 1.0 - gamma / rho - self.trailing_fraction,
            "rho": gamma * (kappa - self.particle_gyration**2) / rho**2 + gamma,
            "trailing_fraction": -kappa,
            "particle_gyration": 2.0 * self.particle_gyration * gamma / rho,
        }
