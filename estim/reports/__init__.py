"""What a reader sees: Markdown, figures, result.json, ArviZ and pandas; one file a subject.  Read `analysis` first."""

from estim.reports.analysis import analysis_report, index_report, report_and_result
from estim.reports.comparison import compare_report, folder_of
from estim.reports.energy import energy_lines, energy_report
from estim.reports.explanation import explanation_lines, slip_words
from estim.reports.first_screen import result_lines
from estim.reports.interop import HOW_TO_GET, can_write_netcdf, to_netcdf
from estim.reports.line import line_lines, line_report
from estim.reports.others import body_lines, body_report, fitted_values, ground_words, map_lines, map_report, measurement_lines, measurement_report
from estim.reports.others import models_report, plan_answers, plan_report, plan_status, straight_line_lines, straight_line_report
from estim.reports.others import batch_line, batch_report, batch_times, calibration_report, full_files, lean_files, trials_report, unlike_fit
from estim.reports.others import price_words, trials_lines, verdicts, with_campaign, with_formats
from estim.reports.reanalysis import called, reanalysis_lines, reanalysis_report
