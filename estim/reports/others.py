"""Reports of what is not a fit of runs: a body's pieces, a measurement model, a line through any points, models compared, plans."""

from estim.reports.measurement import measurement_lines, measurement_report
from estim.reports.models import ground_words, models_report, verdicts
from estim.reports.plan import plan_answers, plan_report, plan_status
from estim.reports.straight_line import straight_line_lines, straight_line_report
from estim.reports.weighing import body_lines, body_report

__all__ = [
    "body_lines", "body_report", "ground_words", "measurement_lines", "measurement_report", "models_report", "plan_answers", "plan_report",
    "plan_status", "straight_line_lines", "straight_line_report", "verdicts",
]
