"""Bytes to records: TOML with its lines, CSV tables, runs; `tracker/` for files of the program
Tracker.

Read `run` first.  Imports `common` alone.
"""

from estim.reading.cells import is_missing
from estim.reading.named_columns import (
    columns_sentence,
    place_of,
    read_columns,
    read_known_columns,
    table_of,
)
from estim.reading.dialect import (
    PLAIN,
    Dates,
    Decimal,
    Dialect,
    Encoding,
    dialect_of_options,
    is_column,
    bare_name,
    name_and_unit,
    names_and_units,
    uncertainty_of,
)
from estim.reading.input_file import TOML_BYTES, leads_out, read_text, refuse_outside, way_to
from estim.reading.layout import (
    Layout,
    are_components,
    first_and_second,
    is_called,
    numeric_columns,
    read_layout,
    value_columns,
)
from estim.reading.run import (
    COLUMNS,
    Run,
    compare_intervals,
    is_timed_track,
    read_run,
    run_of_table,
)
from estim.reading.source import is_table, known_readers, read_suffixes
from estim.reading.table import UNITS, Table, line_numbers, own_name, require_unit
from estim.reading.toml import KeyPath, Places, parse_toml
from estim.reading.tracker.importing import (
    Choices,
    import_track,
    is_track,
    is_tracker_file,
    read_release,
    run_table,
    track_columns,
)
from estim.reading.tracker.plausibility import odd_intervals, of_any_curve
from estim.reading.tracker.track import Unit
