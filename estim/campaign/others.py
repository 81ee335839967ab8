"""What is asked of campaigns beside their runs: models compared, and the frames of the way back."""

from estim.campaign.curve_models import CurveModel
from estim.campaign.noise_models import Candidate
from estim.campaign.selection import way_back

__all__ = ["Candidate", "CurveModel", "way_back"]
