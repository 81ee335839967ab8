"""Many runs one by one, on the cores of this machine or on any `concurrent.futures.Executor`; each
result is written as it comes.

Read `running` first.  Only `reports` and `cli` may import it.
"""

from estim.batch.overview import Spread, odd_runs, spreads
from estim.batch.rows import Row
from estim.batch.running import Settings, run_batch
from estim.batch.units import shard_of, units_of
