"""Reports of what is not a fit of runs: a body's pieces, a measurement model, a line through any points, models compared, plans, maps, trials."""

from estim.reports.batch import batch_line, batch_report, batch_times, full_files, lean_files
from estim.reports.calibration import calibration_report, unlike_fit
from estim.reports.formats import with_formats
from estim.reports.kept_campaign import with_campaign
from estim.reports.measurement import measurement_lines, measurement_report
from estim.reports.models import ground_words, models_report, price_words, verdicts
from estim.reports.plan import plan_answers, plan_report, plan_status
from estim.reports.regimes import fitted_values, map_lines, map_report
from estim.reports.straight_line import straight_line_lines, straight_line_report
from estim.reports.trials import trials_lines, trials_report
from estim.reports.weighing import body_lines, body_report

__all__ = [
    "batch_line", "batch_report", "batch_times", "body_lines", "body_report", "calibration_report", "fitted_values", "full_files", "ground_words",
    "lean_files", "map_lines", "map_report", "measurement_lines", "measurement_report", "models_report", "plan_answers", "plan_report",
    "plan_status", "price_words", "straight_line_lines", "straight_line_report", "trials_lines", "trials_report", "unlike_fit", "verdicts",
    "with_campaign", "with_formats",
]
