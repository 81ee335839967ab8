"""Numbers that are surely a slip of the unit: errors of reading as large as the path, a radius
beside which nothing rolls, speeds that gravity cannot give.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from estim.arrays import FloatArray, max_abs
from estim.campaign.lookup_levels import Levels, StatedNoise
from estim.common import InputError
from estim.problem import Observations, Prior, Scale, centre_of
from estim.reading import Run

_SDS = 5.0  # how far a quantity may lie above its centre
_LARGE = 1.0  # m, a radius that few bodies have which roll on a ramp
# radians by which a body turns that rolls at all, and how long it takes for more, in units of
# sqrt(R/g): that of a slow rocking is longer
_HARDLY, _BRIEFLY = 0.1, 3.0


def check_reading_error(sigma: Scale, run: Run, noise: StatedNoise) -> None:
    """The stated standard deviation of a position against the path, both in the same unit.

    Raises InputError at its line where it is a tenth of the path or more: of such positions nothing
    can be learnt.
    """
    reach = float(np.ptp(run.position))
    if sigma.parameter is None and sigma.value >= 0.1 * reach > 0.0:
        key, unit, slip = (
            ("sigma_x_m", "m", "is it in mm?")
            if run.coordinate == "x_m"
            else ("sigma_theta_rad", "rad", "is it in degrees?")
        )
        raise noise.error(
            f"must be well below the length of the run, {reach:.4g} {unit} ({slip} The key is "
            f"in {unit})",
            key,
            value=sigma.value,
        )


def check_radius(run: Run, quantities: Mapping[str, float | Prior], levels: Levels) -> None:
    """The stated radius against the whole run.

    Raises InputError at its line where so large a body hardly turns, and is recorded for so short a
    time that gravity has hardly begun to turn it: a radius in cm is a hundred times too large.
    """
    level = levels.first("radius_m")
    if level is None or run.coordinate != "x_m":
        return
    radius, g = (centre_of(quantities[name]) for name in ("radius", "g"))
    reach = float(np.ptp(run.position))
    # from rest it takes about twice as long as at the last speed
    columns = run.columns
    time = (
        float(np.ptp(columns["t_s"]))
        if "t_s" in columns
        else 2.0 * reach / (max_abs(columns[run.rate]) or math.inf)
    )
    if radius > _LARGE and reach < _HARDLY * radius and time < _BRIEFLY * math.sqrt(radius / g):
        raise levels.error(
            f"must be in m: with this radius the body turns by {reach / radius:.2g} rad on the "
            f"{reach:.3g} m of run '{levels.run.name}' (is it in cm or mm?)",
            (*level.path, "radius_m"),
            value=level.table.radius_m,
        )


def check_speeds(
    run: Observations, quantities: Mapping[str, float | Prior], *, angular: bool, file: str
) -> None:
    """The speeds of a body released at x = 0, against its energy; raises InputError where units
    must be wrong.

    v^2 <= 2 g (|x| sin|phi| + 2 gamma R)/(1 - gamma/rho), with what is stated of a push, a sag and
    moments in addition.  The centre of mass can fall by no more, and the kinetic energy is M v^2/2
    times at least 1 - gamma/rho (only the particle can be slower than the axle).  Lengths in cm
    exceed that bound a hundredfold; times in ms make motions of a millionth of it, which is rest.
    quantities : of the run, SI units.
    """
    radius, gamma, rho, g = (_largest(quantities[name]) for name in ("radius", "gamma", "rho", "g"))
    position = run.position
    unit = centre_of(quantities["radius"]) if angular else 1.0
    reach, speed = max_abs(position), _typical_speed(run, position)

    def size_of(name: str) -> float:
        return _largest(quantities[name], size=True) if name in quantities else 0.0

    tilt = min(
        size_of("phi") + size_of("phi_zero") + size_of("phi_slope") * reach * unit, 0.5 * math.pi
    )
    share = gamma / min(rho, centre_of(quantities["rho"]))
    turning = sum(
        size_of(f"moment_{part}") for part in ("once_cos", "once_sin", "twice_cos", "twice_sin")
    )
    fall = (
        reach * unit * math.sin(tilt)
        + (2.0 * (gamma + turning) + size_of("release_energy")) * radius
        + 4.0 * size_of("sag")
    )
    # with so little mass besides the particle, speeds have no useful bound
    if not fall > 0.0 or share > 0.95:
        return
    # 4 M v^2/2 is more than the kinetic energy of any body that rolls
    bound = (
        math.sqrt(
            2.0 * g * fall / (1.0 - share) + 4.0 * size_of("release_speed") ** 2 / (1.0 - share)
        )
        / unit
    )
    name, rate = ("theta_rad", "rad/s") if angular else ("x_m", "m/s")
    # three times the energy that gravity can give
    if speed > math.sqrt(3.0) * bound:
        slip = "degrees" if angular else "cm or mm"
        length = (
            f"{reach:.4g} rad"
            if angular
            else f"{reach:.4g} m, {reach / centre_of(quantities['radius']):.0f} radii,"
        )
        most = f"gravity gives this body at most {bound:.3g} {rate} from rest"
        raise InputError(
            f"reaches {length} at {speed:.3g} {rate}, where {most}: is it in {slip}, or the "
            "time not in s?",
            field=name,
            file=file,
        )
    if run.t is not None and 0.0 < speed < math.sqrt(1e-6) * bound:
        raise InputError(
            f"spans {np.ptp(run.t):.4g} s at {speed:.3g} {rate} or less, where gravity gives "
            f"this body up to {bound:.3g} {rate}: is it in ms?",
            field="t_s",
            file=file,
        )


def _typical_speed(run: Observations, position: FloatArray) -> float:
    """Nearly the largest speed: means over an eighth of the time where times are known; a few bad
    frames do not matter.
    """
    if run.t is None:
        return float(np.quantile(np.abs(run.y), 0.9))
    # speeds are taken over this part of the time, where errors of the positions do not matter
    later = np.searchsorted(run.t, run.t + np.ptp(run.t) / 8.0)
    first = np.flatnonzero(later < run.t.size)
    return float(
        np.quantile(
            np.abs(position[later[first]] - position[first]) / (run.t[later[first]] - run.t[first]),
            0.9,
        )
    )


def _largest(source: float | Prior, *, size: bool = False) -> float:
    """The largest value that a quantity may have, or the largest size."""
    if isinstance(source, float):
        return abs(source) if size else source
    high = min(source.high, source.centre + _SDS * source.sd)
    return max(high, -max(source.low, source.centre - _SDS * source.sd)) if size else high
