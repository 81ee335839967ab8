"""How large the program is, as Markdown: python benchmarks/size.py

Nodes of the syntax tree (`ast.walk`), module-level numbers that tune something, and the files and
functions of estim that a fit of three parameters and `estim fit` of one run enter
(`sys.setprofile`; what runs at import is not counted).
"""

from __future__ import annotations

import ast
import contextlib
import io
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))


def trees() -> list[ast.Module]:
    return [ast.parse(path.read_text(encoding="utf-8")) for path in (ROOT / "estim").rglob("*.py")]


def is_number(node: ast.expr | None) -> bool:
    """A number, or a tuple of numbers, with or without a sign."""
    if isinstance(node, ast.Tuple):
        return bool(node.elts) and all(is_number(one) for one in node.elts)
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    )


def n_constants(tree: ast.Module) -> int:
    """Numbers with a name in capitals at the top of a module; a tuple of names that takes a tuple
    of numbers counts each.
    """
    n = 0
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and is_number(node.value):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [
                name
                for target in targets
                for name in ast.walk(target)
                if isinstance(name, ast.Name)
            ]
            n += sum(name.id.isupper() for name in names)
    return n


def entered(run: Callable[[], object]) -> tuple[int, int]:
    """Files and functions that `run` enters the second time, when everything has been imported."""
    run()
    seen: set[tuple[str, str, int]] = set()
    ours = str(ROOT / "estim")

    def profile(frame: FrameType, event: str, _argument: Any) -> None:
        code = frame.f_code
        if (
            event == "call"
            and not code.co_name.startswith("<")
            and code.co_filename.startswith(ours)
        ):
            seen.add((code.co_filename, code.co_name, code.co_firstlineno))

    sys.setprofile(profile)
    try:
        run()
    finally:
        sys.setprofile(None)
    return len({file for file, _, _ in seen}), len(seen)


def fit_a_curve() -> None:
    import numpy as np

    from estim import fit_curve

    x = np.linspace(0.0, 5.0, 30)
    fit_curve(
        "a*exp(-x/tau) + c",
        x,
        2.0 * np.exp(-x) + 0.5 + 0.05 * np.random.default_rng(1).standard_normal(x.size),
        u_y=0.05,
    )


def fit_a_run() -> None:
    from estim.__main__ import main

    with tempfile.TemporaryDirectory() as folder:
        sys.argv = [
            "estim",
            "fit",
            str(ROOT / "data/replica/campaign.toml"),
            "--run",
            "light-04",
            "--out",
            folder + "/out",
        ]
        try:
            with (
                contextlib.redirect_stdout(io.StringIO()),
                contextlib.redirect_stderr(io.StringIO()),
            ):
                main()
        except SystemExit as end:
            if end.code:
                raise


if __name__ == "__main__":
    parsed = trees()
    print("| | |\n|---|---|")
    print(f"| nodes of the syntax tree | {sum(1 for tree in parsed for _ in ast.walk(tree)):,} |")
    print(f"| constants at the top of modules | {sum(map(n_constants, parsed))} |")
    for what, run in (("`fit_curve`", fit_a_curve), ("`estim fit`, one run", fit_a_run)):
        n_file, n_function = entered(run)
        print(f"| {what} enters | {n_function} functions in {n_file} files |")
