"""What the fields of a question are called, and the messages of a command in these words: of an
error or a warning that names an option or a key, the page names its own field, or where else the
option is given.  `estim` knows
nothing of the page, so that its report is the same at each door.
"""

from __future__ import annotations

import re

from estim.common import PhraseTable, phrase

LABELS = PhraseTable(
    {
        "window": "Range of x that is fit (window)",
        "formula": "Formula",
        "x": "x",
        "y": "y, or the values",
        "u-x": "Uncertainty of x (u_x)",
        "u-y": "Uncertainty of y (u_y)",
        "group": "Groups",
        "track": "Track of the file",
        "radius_m": "Radius R (m)",
        "phi_deg": "Tilt φ (degrees)",
        "theta0_deg": "Angle at release θ₀ (degrees)",
        "sigma_x_m": "Scatter of one position (m)",
        "gamma": "Eccentricity γ",
        "kappa": "Inertia κ",
        "mass_disk_kg": "Mass of the disk (kg)",
        "mass_particle_kg": "Mass at its rim (kg)",
        "unit": "Unit of the lengths",
        "release": "Release",
        "offset_m": "Position at release (m)",
        "sigma_v_m_s": "Scatter of one speed (m/s)",
        "x_max_m": "Fit only up to this position (m)",
        "rolling_resistance": "Coefficient of rolling resistance",
        "g": "Gravity g (m/s²)",
        "ramp_length_m": "Distance between the supports of the incline (m)",
        "unmodelled_force": (
            "A force that would not surprise you (unmodelled_force, a fraction of the weight)"
        ),
        "own": "One value for each file",
        "value": "What you know already",
        "start": "Starting values",
        "low": "Lower limits",
        "high": "Upper limits",
        "robust": "Points that are far off (robust)",
        "kind": "What the numbers are",
        "title": "Title of the report",
        "decimal": "Decimal mark",
        "sheet": "Sheet of a workbook",
        "correlated": "errors of neighbouring points are correlated",
        "jitter": "y has further errors beside those stated",
        "noise": "y are numbers of events (counts)",
        "columns": "Names of the columns",
        "skip-rows": "Lines above the table that are not read",
        "dates": "Order of day and month",
        "encoding": "Encoding of the letters",
        "seed": "Seed of the random numbers",
        "max-steps": "Most steps of the sampler",
        "figures": "Figures of the report",
    }
)
"""Name of a field, which is that of the option or of the key of a rolling disk -> its label."""
REFITS = PhraseTable(
    {
        "formula": "Fit again with another formula",
        "value": "Fit again with a known value of {name}",
        "u-y": "Fit again with other uncertainties of y",
        "robust": "Fit again and allow for points that are far off",
        "correlated": "Fit again with correlated errors, if the formula is known to be right",
        "jitter": "Fit again with further errors of y, of a size that the points show",
    }
)
"""An option that a result advises -> the label of its link."""
_AS_OPTIONS = {"ux": "u-x", "uy": "u-y"}  # of `estim line`
_NAME = r"[a-z]\w*(?:-[a-z]+)*"
_OPTION = re.compile(
    rf"(?<!\w)'--(?:rolling )?(?P<quoted>{_NAME})'(?!\w)"  # the whole of what is quoted
    rf"|^'--(?P<given>{_NAME})(?P<behind> \w+)'"
    r"|^'(?P<key>window|start|low|high|robust|correlated|jitter|u_x|u_y)'(?= )"
    r"|(?<!\w)'[^'\n]*'(?!\w)"  # words of others
    rf"|(?<![^\s(])--(?P<plain>{_NAME})(?=[\s),;:]|\.?(?:\s|$))"
)
_TWICE = re.compile(r"(“[^”]*”) (?:/ \1|\((?:or|o) \1\))")  # an option that has two names
_STATED = r"(?:u_\S+|[a-z_]+ = [^;()]+) (?:in a campaign|en una campaña)"
_IN_A_CAMPAIGN = re.compile(
    rf"; {_STATED}(?=\))| \({_STATED}\)"
    r"|, or \{start = 1\.0\} in a campaign(?=\))"
    r"| \((?:in a campaign|en una campaña): [a-z_]+(?: = true)?\)"
)


def on_page(words: str) -> str:
    """`words` of a command, with fields of the page for its options, and without what is written
    for whoever writes a campaign.
    """
    words = _IN_A_CAMPAIGN.sub("", words.removeprefix("command line: "))
    return _TWICE.sub(r"\1", _OPTION.sub(_called, words))


def _called(match: re.Match[str]) -> str:
    name = match["quoted"] or match["given"] or match["key"] or match["plain"] or ""
    name = name.replace("_", "-") if match["key"] else name
    label = LABELS.get(_AS_OPTIONS.get(name, name))
    if label:
        return f"“{label}”{match['behind'] or ''}"
    return match[0] + (phrase(" (at the command line)") if match["plain"] else "")
