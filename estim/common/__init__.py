"""What every package may use: errors, quantities, labels and units, statuses, the one file that
writes.  Read `statuses` first.
"""

from estim.common.errors import (
    EstimError,
    InputError,
    Interrupted,
    NumericalError,
    in_file,
    in_its_file,
    listed,
    require_one_of,
    shorten,
)
from estim.common.escaping import (
    Json,
    Markdown,
    as_csv,
    as_json,
    code,
    destination,
    is_nested_deeper,
    json_of,
    markdown,
    mathtext,
    number,
    one_line,
    plain,
    unescaped,
)
from estim.common.interruption import ended_by_signals
from estim.common.jobs import run_parallel
from estim.common.labels import (
    FIGURE_CHOICES,
    FigureChoice,
    KINDS,
    OF_BODY,
    Label,
    Notation,
    bracketed,
    kind_words,
    split_level,
    table,
)
from estim.common.unit_symbols import (
    in_unit,
    is_angle,
    is_in_degrees,
    is_unit,
    powers_in,
    same_numbers,
    same_unit,
)
from estim.common.lookalikes import folded, same_looks
from estim.common.phrases import (
    LANGUAGES,
    PhraseTable,
    at_commands,
    language,
    later,
    phrase,
    spoken,
)
from estim.common.checkpoints import PieceStore, key_of
from estim.common.ownership import REPORT_FILES, remove_own, replace_own, require_own, require_room
from estim.common.quantity_text import (
    behind,
    EXTREME,
    Quantity,
    difference,
    e_n,
    extreme,
    format_p,
    format_quantity,
    format_rounded,
    in_ascii,
    interval,
    p_digits,
    per_cent,
    percentage,
    raised,
    read_number,
    read_quantity,
    read_with_unit,
    require_clear_share,
    signed,
    significant,
    with_unit,
)
from estim.common.statuses import (
    PROBABILITIES,
    QUANTILES,
    Amount,
    Finding,
    Kind,
    Status,
    decide,
    gravest,
    wrong,
)
from estim.common.storage import (
    Files,
    held,
    inputs_read,
    names_in,
    note_input,
    read_file,
    remove_files,
    write_whole,
)
from estim.common.random_streams import Stream, stream
from estim.common.record_table import Shown, Tabled
