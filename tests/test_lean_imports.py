"""The command line's own processes leave what they do not use; nothing is missing there, and a user's Python is as it was."""

from __future__ import annotations

import subprocess
import sys

import pytest


def said(code: str) -> list[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


def test_a_users_python_has_the_packages_as_they_are() -> None:
    code = """
import estim
estim.fit_curve("a*x + b", [0.0, 1.0, 2.0, 3.0], [1.0, 3.1, 4.9, 7.0], u_y=0.1, start={"a": 1.0, "b": 0.0})
import lmfit, lmfit.minimizer, scipy.stats
from estim.lean_imports import is_lean
print(is_lean(), isinstance(lmfit.Model, type), lmfit.minimizer.norm_dist is scipy.stats.norm)
"""
    assert said(code) == ["False", "True", "True"]


def test_nothing_is_missing_where_imports_are_lean() -> None:
    """A user's function, which a campaign may name, finds all of lmfit there."""
    pytest.importorskip("pandas", reason="needs pandas")
    code = """
import sys
from estim.lean_imports import import_lean
import_lean(); import_lean()
print(len([one for one in sys.meta_path if getattr(one, "__module__", "") == "estim.lean_imports"]))
from lmfit.minimizer import minimize, norm_dist
from lmfit.parameter import Parameters
import lmfit, lmfit.jsonutils
print(isinstance([], lmfit.jsonutils.DataFrame), *[name in sys.modules for name in ("pandas", "matplotlib", "scipy.stats")])
x = [0.0, 1.0, 2.0]
print(round(lmfit.Model(lambda x, a: a * x).fit([0.0, 2.0, 4.0], x=x, a=1.0).params["a"].value, 6), lmfit.Parameters is Parameters)
import pandas, scipy.stats
print(norm_dist.pdf(0.0) == scipy.stats.norm.pdf(0.0), isinstance(pandas.DataFrame(), lmfit.jsonutils.DataFrame))
from scipy.optimize import shgo
print(bool(shgo(lambda x: float(x[0] ** 2), [(-1.0, 2.0)], sampling_method="simplicial").success))
print(lmfit.Parameters().loads(lmfit.Parameters().dumps()) == lmfit.Parameters())
try: lmfit.none
except AttributeError as error: print("none" in str(error))
"""
    lines = said(code)
    assert lines[:5] == ["1", "False", "False", "False", "False"]
    assert lines[5:9] == ["2.0", "True", "True", "True"]
    assert lines[9:] == ["True", "True", "True"]


def test_tools_that_others_load_for_themselves_come_when_they_are_asked_for() -> None:
    code = """
import sys
from estim.lean_imports import import_lean
import_lean()
import matplotlib.figure, numpy, scipy.optimize, scipy.special
late = ("numpy.f2py.rules", "mpl_toolkits.mplot3d.axes3d", "scipy.linalg.interpolative")
print(*[name in sys.modules for name in late], bool(scipy.special.chdtr.__doc__))
print(matplotlib.figure.Figure().add_subplot(projection="3d").name, matplotlib.figure.Figure().add_subplot(projection="polar").name)
numpy.testing.assert_allclose(1.0, 1.0)
print(numpy.f2py.get_include().endswith("src"), scipy.optimize.linprog([1.0], bounds=[(2.0, 3.0)]).x[0])
"""
    assert said(code) == ["False", "False", "False", "True", "3d", "polar", "True", "2.0"]


def test_what_is_not_installed_is_missed_as_ever() -> None:
    code = """
import sys
from estim import lean_imports
lean_imports.import_lean()
lean_imports.find_spec = lambda name: None
sys.modules["pandas"] = None
from lmfit.minimizer import HAS_PANDAS
print(HAS_PANDAS)
"""
    assert said(code) == ["False"]
