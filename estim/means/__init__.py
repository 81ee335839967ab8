"""The mean of several values of one quantity: weighted, with a dark uncertainty, or of readings in
groups.  Read `averages` first.
"""

from estim.means.table_mean import TableMean, mean_of_table
from estim.means.two_values import compare_values
