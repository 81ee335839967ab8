"""The campaign file: TOML to checked tables, with the line of every key for messages.

`docs/campaign.md` explains the format to its users.  Here it is only read and checked;
`estim.campaign.binding` gives it meaning.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta

from estim.campaign.curve_keys import CurveRunTable, CurveTable
from estim.campaign.dialect_table import DialectKeys
from estim.campaign.key_table import KeyTable
from estim.campaign.name_rules import check_body_names, check_run_names
from estim.campaign.part_table import AnyPart
from estim.campaign.plan_table import PlanTable, check_plan
from estim.campaign.prior_table import Finite, Positive, Stated
from estim.campaign.type_mismatch import hint, located, mismatch, of_table, suggestion
from estim.common import EXTREME, InputError, extreme, phrase
from estim.reading import (
    TOML_BYTES,
    KeyPath,
    Places,
    Unit,
    leads_out,
    parse_toml,
    read_text,
    refuse_outside,
    way_to,
)

_OF_BODIES = ("shared", "parts", "bodies", "line", "trials", "published")
Kind = Literal["synthetic", "measured", "published"]

_FIELDS = {  # that messages of readers name; any other may be a word of the file
    "header",
    "row",
    "rows",
    "byte",
    "text",
    "size",
    "number of lines",
    "XML",
    "archive",
    "track",
    "tracks",
    "t",
    "x",
    "y",
    "release",
    "along",
    "unit",
    "frame_ms",
    "drop_duplicates",
}


class NoiseTable(KeyTable, frozen=True):
    model: Literal["independent", "differentiated", "positions"] | None = None
    sigma_x_m: Stated = None
    sigma_theta_rad: Stated = None
    sigma_v_m_s: Stated = None
    sigma_omega_rad_s: Stated = None
    encoder_step_rad: Positive | None = None
    exposure_s: float | None = None
    derivative: Literal["central", "five-point", "spill2"] | None = None
    scatter: Stated = None
    robust: Literal["student-t", "mixture"] | None = None


class WindowTable(KeyTable, frozen=True):
    t_min_s: Finite | None = None
    t_max_s: Finite | None = None
    x_min_m: Finite | None = None
    x_max_m: Finite | None = None
    theta_min_rad: Finite | None = None
    theta_max_rad: Finite | None = None


class EffectTable(DialectKeys, frozen=True):
    """What is known of a run besides gravity; how its table is written may be stated at the same
    levels (`DialectKeys`).

    An effect that is stated at no level is exactly zero, but for `scale_x` and `scale_t`, which
    have a default prior.

    release_energy : kinetic energy at release / (M g R).
    release_speed_m_s : the same as a speed of the axle.
    scale_x, scale_t : relative errors of the scale of length and of the clock.
    resisting_moment_n_m : torque of bearings and cords.
    load_resistance : rolling resistance in proportion to the normal force.
    viscous_drag_per_s, quadratic_drag_per_m : drag force / (M v) and / (M v^2).
    moment_once_cos, ... : first and second harmonic of a torque per turn / (M g R).
    phi_slope_deg_m, phi_slope_rad_m : gradient of the inclination, degrees or radians per metre.
    sag_m : sag of the ramp midway between its supports.
    ramp_length_m, ramp_start_m : exact; distance between the supports, and from the lower one to
        the release.
    distortion_m : shift of the middle of the image by the lens.
    picture_length_m, picture_start_m : exact; length of the image, and from its lower end to the
        release.
    """

    release_energy: Stated = None
    release_speed_m_s: Stated = None
    scale_x: Stated = None
    scale_t: Stated = None
    resisting_moment_n_m: Stated = None
    load_resistance: Stated = None
    viscous_drag_per_s: Stated = None
    quadratic_drag_per_m: Stated = None
    moment_once_cos: Stated = None
    moment_once_sin: Stated = None
    moment_twice_cos: Stated = None
    moment_twice_sin: Stated = None
    phi_slope_deg_m: Stated = None
    phi_slope_rad_m: Stated = None
    sag_m: Stated = None
    ramp_length_m: Positive | None = None
    ramp_start_m: float | None = None
    distortion_m: Stated = None
    picture_length_m: Positive | None = None
    picture_start_m: float | None = None


Degrees = Annotated[float, Meta(ge=0.0, lt=45.0)]  # an uncertainty of an angle
# the same of each reading: no protractor is better, and the error of a sine would be lost
OfReading = Annotated[float, Meta(ge=1e-4, lt=45.0)]


class TrialsTable(KeyTable, frozen=True, kw_only=True):
    """u_phi_deg, u_theta_deg : standard uncertainties of a tilt, and of one angle as set.
    release_deg : scale of what the hand costs.
    """

    file: str
    body: str
    u_phi_deg: Degrees
    # no angle is set more closely, and the integral over the tilt has no nodes for less
    u_theta_deg: Annotated[float, Meta(ge=0.01, lt=45.0)]
    release_deg: Degrees = 3.0
    u_zero_phi_deg: Degrees = 0.0
    u_zero_theta_deg: Degrees = 0.0


class LevelTable(EffectTable, frozen=True):
    """What may stand at every level: [shared], [bodies.NAME], [[runs]]."""

    radius_m: Stated = None
    gamma: Stated = None
    kappa: Stated = None
    rho: Stated = None
    trailing_fraction: Stated = None
    particle_gyration: Stated = None
    mass_disk_kg: Stated = None
    mass_particle_kg: Stated = None
    mass_trailing_kg: Stated = None
    parts: list[str] | None = None
    particle: list[str] | None = None
    phi_deg: Stated = None
    phi_rad: Stated = None
    theta0_deg: Stated = None
    theta0_rad: Stated = None
    phi_zero_deg: Stated = None
    phi_zero_rad: Stated = None
    theta0_zero_deg: Stated = None
    theta0_zero_rad: Stated = None
    rolling_resistance: Stated = None
    g: Stated = None
    friction: Stated = None
    release_time_s: Stated = None
    offset_m: Stated = None
    offset_rad: Stated = None
    unmodelled_force: float | None = None
    between_runs: dict[str, Positive] | None = None
    noise: NoiseTable | None = None
    window: WindowTable | None = None


class RunTable(LevelTable, frozen=True, kw_only=True):
    name: str
    body: str
    file: str
    track: str | None = None
    along: str | float | None = None
    unit: Unit | None = None
    release: Literal["first", "keep"] | float | None = None
    frame_ms: float | None = None
    drop_duplicates: bool | None = None
    leave_out_s: list[float] | None = None


class LineTable(KeyTable, frozen=True, kw_only=True):
    file: str
    body: str
    u_phi_deg: OfReading | None = None
    u_theta_min_deg: OfReading | None = None
    u_zero_phi_deg: Degrees = 0.0
    u_zero_theta_min_deg: Degrees = 0.0


class DerivedTable(KeyTable, frozen=True):
    formula: str
    unit: str | None = None
    symbol: str | None = None
    meaning: str | None = None


class _TopTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    title: str
    kind: Kind
    published: str | None = None
    shared: LevelTable = LevelTable()
    parts: dict[str, AnyPart] = {}
    bodies: dict[str, LevelTable] = {}
    runs: list[dict[str, Any]] = []
    line: LineTable | None = None
    trials: TrialsTable | None = None
    curve: CurveTable | None = None
    derived: dict[str, str | DerivedTable] = {}
    plan: PlanTable = PlanTable()


@dataclass(frozen=True, eq=False)
class CampaignFile:
    """A campaign file as read, structure checked, numbers not yet interpreted.

    files : run -> its file as written.
    plan : what might be measured next.
    published, shared, bodies, runs, line, trials, parts : of rolling bodies.
    curve, curve_runs : of a user's own curve; None and none where the runs are of rolling bodies.
    written : the text of a campaign that stands in no file, else "".
    """

    path: Path
    sha256: str
    places: Places
    title: str
    kind: Kind
    derived: Mapping[str, str | DerivedTable]
    files: Mapping[str, str]
    plan: PlanTable
    published: str | None
    shared: LevelTable
    bodies: Mapping[str, LevelTable]
    runs: tuple[RunTable, ...]
    line: LineTable | None
    trials: TrialsTable | None
    parts: Mapping[str, AnyPart]
    curve: CurveTable | None
    curve_runs: tuple[CurveRunTable, ...]
    written: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the runs."""
        return tuple(self.files)

    def error(
        self, rule: str, path: KeyPath, *, field: str | None = None, value: object = None
    ) -> InputError:
        """An InputError at the line of a key."""
        return self.places.error(rule, path, field=field, value=value)

    def file_of(self, index: int) -> Path:
        """The file of run number `index`.  Raises InputError at its line in the campaign where
        there is no such file.
        """
        written = self.files[self.names[index]]
        refuse_outside(self.path.parent / written)
        try:
            (self.path.parent / written).stat()
        except (FileNotFoundError, ValueError):
            raise self.error(
                "cannot be found (no such file; names are relative to the folder of the "
                "campaign file)",
                ("runs", index, "file"),
                value=written,
            ) from None
        except OSError:  # too long a name, for instance: its reader says so
            pass
        return self.path.parent / written

    def with_levels(self, change: Callable[[Any], Any]) -> CampaignFile:
        """The file with every table that applies to runs (`LevelTable`) changed, each to one of its
        own kind.
        """
        bodies = {name: change(table) for name, table in self.bodies.items()}
        runs = tuple(change(run) for run in self.runs)
        return replace(self, shared=change(self.shared), bodies=bodies, runs=runs)

    @contextmanager
    def reading(self, path: Path, columns: Collection[str] = ()) -> Iterator[None]:
        """While a file of the campaign is read: nothing of one outside its folder is quoted in an
        error, which may be no table at all.
        """
        try:
            yield
        except InputError as error:
            if error.file == str(path) and leads_out(path, self.path.parent):
                raise error.without_quotes({*_FIELDS, *columns}) from None
            raise

    def out_of_folder(self, written: str) -> str | None:
        """A sentence that says so where the file that is written in the campaign lies outside its
        folder, links followed; else None.
        """
        path = self.path.parent / written
        if not leads_out(path, self.path.parent):
            return None
        home, end = os.path.realpath(self.path.parent), os.path.realpath(path)
        link = phrase(": a link leads to {place}", place=way_to(end, home))
        return phrase("{file} lies outside the folder of the campaign", file=written) + link * (
            os.path.normpath(os.path.join(home, written)) != end
        )

    def files_outside(
        self, *, runs: bool = True, line: bool = False, published: bool = False
    ) -> tuple[str, ...]:
        """Such a sentence for each of these files."""
        written = list(self.files.values()) if runs else []
        written += [table.file for table in (self.line, self.trials) if line and table is not None]
        written += [self.published] if published and self.published is not None else []
        return tuple(
            sentence for file in dict.fromkeys(written) if (sentence := self.out_of_folder(file))
        )


def read_campaign_file(path: Path, *, measured: bool = True) -> CampaignFile:
    """The campaign file at `path`.  Raises InputError with file, line, key, rule and value.

    measured : whether it must hold runs or a theta_min series; else its bodies will do.
    """
    text, digest = read_text(path, limit=TOML_BYTES)
    return _of_text(path, text, digest, measured)


@lru_cache(maxsize=1)  # a batch reads the same text anew for each of thousands of runs
def _of_text(path: Path, text: str, digest: str, measured: bool) -> CampaignFile:
    tree, places = parse_toml(text, str(path))
    return _checked_file(path, digest, tree, places, measured=measured)


def campaign_file_of(text: str, path: Path, *, shown: str) -> CampaignFile:
    """The campaign in a text that stands in no file, as if it did at `path`.  shown : how errors
    name it.  Raises InputError.
    """
    tree, _ = parse_toml(text, shown)
    digest = hashlib.sha256(text.encode()).hexdigest()
    return replace(
        _checked_file(path, digest, tree, Places(shown, {}), measured=True), written=text
    )


def _checked_file(
    path: Path, digest: str, tree: dict[str, Any], places: Places, *, measured: bool
) -> CampaignFile:
    for key in _OF_BODIES if tree.get("curve") else ():
        if tree.get(key):
            raise places.error("cannot be combined with a [curve] table", (key,))
    top = checked(tree, _TopTable, places, ())
    runs, curve_runs = list[RunTable](), list[CurveRunTable]()
    if top.curve is None:
        runs = checked(top.runs, list[RunTable], places, ("runs",))
    else:
        curve_runs = checked(top.runs, list[CurveRunTable], places, ("runs",))
    needed = measured or top.curve is not None
    if needed and not top.runs and top.line is None and top.trials is None:
        others = ", a [line] or a [trials] table" if top.curve is None else ""
        rule = f"must hold at least one [[runs]] table{others}"
        raise places.error(rule, (), field="campaign")
    every: list[RunTable | CurveRunTable] = [*runs, *curve_runs]
    files = {run.name: run.file for run in every}
    check_run_names([run.name for run in every], places)
    check_body_names(top.bodies, places)
    of_body: list[tuple[KeyPath, str]] = [
        *((("runs", i), run.body) for i, run in enumerate(runs)),
        *((("line",), table.body) for table in (top.line,) if table is not None),
        *((("trials",), table.body) for table in (top.trials,) if table is not None),
    ]
    for path_of_table, body in of_body:
        if body not in top.bodies:
            raise places.error(
                f"must name one of the bodies ({', '.join(top.bodies) or 'none defined'})",
                (*path_of_table, "body"),
                value=body,
            )
    check_plan(top.plan, tuple(files), places, own_curve=top.curve is not None)
    tables = msgspec.structs.asdict(top) | {"runs": tuple(runs), "curve_runs": tuple(curve_runs)}
    return CampaignFile(path=path, sha256=digest, places=places, files=files, **tables)


T = TypeVar("T")
_FILES = {  # a key at the top that only such a file has
    "kind": "a campaign",
    "instruments": "a design of a synthetic campaign",
    "measurand": "a measurement model",
    "number": "a file of published values",
}


def checked(tree: object, kind: type[T], places: Places, path: KeyPath) -> T:
    """`tree` as a record of type `kind`; a mismatch becomes an InputError at its line."""
    if path == ():
        _check_numbers(tree, places, ())
        _check_file(tree, kind, places)
    try:
        return msgspec.convert(tree, kind)
    except msgspec.ValidationError as error:
        message, _, where = str(error).partition(" - at `$")
        inner = re.findall(r"\.\.\.|[^.\[\]`]+", where)
        within, entry = located(tree, kind, inner)
        full = (*path, *within)
        if match := re.search(r"(unknown|missing required) field `(.*)`", message):
            mark, keys = of_table(kind, inner, entry)
            if match[1] == "unknown":
                rule = f"is not a known key here{mark}{suggestion(match[2], keys)}"
            else:
                rule = f"is missing{mark}{hint(kind, [*inner, match[2]])}"
            raise places.error(rule, (*full, match[2])) from None
        rule, value = mismatch(message, kind, inner, entry)
        raise places.error(rule, full, field=None if full else "campaign", value=value) from None


def _check_file(tree: object, kind: type, places: Places) -> None:
    """A file that is to be of this `kind` has no key that tells it for another one."""
    known = getattr(kind, "__struct_fields__", ())
    needed = next((words for key, words in _FILES.items() if key in known), None)
    for key, words in _FILES.items():
        if needed and isinstance(tree, dict) and key in tree and key not in known:
            raise places.error(f"is a key of {words}; here {needed} is needed", (key,))


def _check_numbers(tree: object, places: Places, path: KeyPath) -> None:
    """Whole numbers fit into 64 bits (what TOML promises to read), and no number is so large or
    small that its square is none.
    """
    if isinstance(tree, dict | list):
        for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
            _check_numbers(value, places, (*path, key))
    elif isinstance(tree, int) and abs(tree) >= 2**63:
        raise places.error(
            "must be a number of less than 19 digits", path, value=f"{str(tree)[:12]}..."
        )
    elif isinstance(tree, float) and extreme(tree):
        raise places.error(EXTREME, path, value=tree)
