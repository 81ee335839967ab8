"""A measurement model in a file: inputs, formulas of the outputs, GUM and Monte Carlo side by side,
regions of two outputs.

Read `model_file` first, then `propagating`.
"""

from estim.measurement_model.model_file import model_of_formula, read_model
from estim.measurement_model.propagating import Propagation, Region, ellipse, propagate
