"""A page in the browser: drop a file, get the report.  Another front door of the command line.

A question on a page becomes the arguments of a command, which a process of its own runs
(`question`, `job_queue`): messages, exit codes and reports are those of the command line.  No
physics, no statistics and no reading of formats here.  Read `serving` first, then `pages`.
"""

from estim.web.listening import At
from estim.web.serving import missing_packages, serve
