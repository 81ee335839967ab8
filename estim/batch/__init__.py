"""Many runs one by one, on the cores of this machine or on any `concurrent.futures.Executor`; each
result is written as it comes.

Read `running` first.  Only `reports`, `web` and `cli` may import it.
"""

from estim.batch.overview import RunScatter, odd_runs, spreads
from estim.batch.rows import RunRow, failed, row_of
from estim.batch.running import Settings, run_batch
from estim.batch.units import Unit, shard_of, units_of
