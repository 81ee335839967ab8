"""What each status means."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import Status

STATUS_WORDS = MappingProxyType(
    {
        Status.CONTRADICTION: "the data contradict what was stated: no number below is a result",
        Status.NOT_CONVERGED: "the computation did not finish: no number below is a result",
        Status.METHODS_DISAGREE: "two methods that should agree do not: no number below is a result",
        Status.MULTIMODAL: "several separate solutions fit the data: no single number below is a result",
        Status.NOT_IDENTIFIED: "data and priors do not determine the parameters: no number below is a result",
        Status.POOR_FIT: "the curve does not explain the data: no number below is a result",
        Status.AT_BOUND: "the data push a parameter against the edge of its range, farther than chance would: no number below is a result",
        Status.NOT_CALIBRATED: "intervals do not hold simulated truths as often as they say",
        Status.OK: "the result can be used as it stands",
    }
)
