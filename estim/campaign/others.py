"""What is asked of campaigns beside their runs: models compared, the frames of the way back,
campaigns made of a table.
"""

from estim.campaign.curve_models import CurveModel
from estim.campaign.new_campaign import columns_of, drafted_campaign
from estim.campaign.noise_models import Candidate
from estim.campaign.selection import way_back
from estim.campaign.table_campaign import TableChoices, campaign_of_table, pairs

__all__ = [
    "Candidate",
    "CurveModel",
    "TableChoices",
    "campaign_of_table",
    "columns_of",
    "drafted_campaign",
    "pairs",
    "way_back",
]
