"""A measurement model in a file: inputs, formulas of the outputs, GUM and Monte Carlo side by side,
regions of two outputs.

Read `model_file` first, then `propagating`.
"""

from estim.measurement.model_file import model_of_formula, read_model
from estim.measurement.propagating import Propagation, propagate
from estim.measurement.coverage_regions import Region, ellipse
