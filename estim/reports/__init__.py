"""What a reader sees: Markdown, figures, result.json, ArviZ and pandas; one file a subject.  Read
`analysis` first.
"""

from estim.reports.analysis import analysis_report, index_report, report_and_result
from estim.reports.comparison import compare_report, folder_of
from estim.reports.energy import energy_lines, energy_report
from estim.reports.explanation import explanation_lines, slip_words
from estim.reports.interop import HOW_TO_GET, can_write_netcdf, to_netcdf
from estim.reports.line import line_lines, line_report
from estim.reports.reanalysis import called, reanalysis_lines, reanalysis_report
from estim.reports.result import result_lines
from estim.reports.batch import batch_line, batch_report, batch_times, full_files, lean_files
from estim.reports.calibration import calibration_report, unlike_fit
from estim.reports.formats import with_formats
from estim.reports.pages import with_campaign
from estim.reports.measurement import measurement_lines, measurement_report
from estim.reports.models import ground_words, models_report, price_words, verdicts
from estim.reports.plan import plan_answers, plan_report, plan_status
from estim.reports.regimes import fitted_values, map_lines, map_report
from estim.reports.straight_line import straight_line_lines, straight_line_report
from estim.reports.trials import trials_lines, trials_report
from estim.reports.bodies import body_lines, body_report
