"""The way in: `python -m estim` and the command `estim`.

A file beside the data that has the name of a module is not imported.
"""

from __future__ import annotations

import gc
import os
import sys

from estim.shadowed_modules import forget_working_folder

_INTERRUPTED = 130  # that of `estim.cli.commands`, which cannot be imported yet
# made before garbage is looked for: modules make many that stay, and looking through them took a
# tenth of a short command
_OBJECTS = 500_000
_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # read when NumPy is loaded


def main() -> None:
    """Run the command line."""
    gc.set_threshold(_OBJECTS)
    if "OMP_NUM_THREADS" not in os.environ:
        # the matrices are small: a second thread of linear algebra only waits for the first
        for name in _THREADS:
            os.environ.setdefault(name, "1")
    try:
        from estim.cli.commands import main as command

        command()
    except KeyboardInterrupt:  # while modules are loaded; later `exit_code` says so
        sys.stderr.write("interrupted\n")
        sys.exit(_INTERRUPTED)


if __name__ == "__main__":
    forget_working_folder()
    main()
