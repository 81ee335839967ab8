"""What to measure next: expected standard deviations by linear theory, and how far that is to be
trusted.  Read `planning` first.
"""

from estim.planning.halving import Halving
from estim.planning.planning import FAR, Plan, plan
from estim.planning.expected_uncertainty import Option
from estim.planning.candidates import MORE
