"""A campaign file bound to curves: levels, windows, noise, designs, variations.  Read `bodies`
first, `lookup_levels` for what runs share.
"""

from estim.campaign.binding import gamma_of_body, gamma_origin, parted_bodies, resistance_of_body
from estim.campaign.campaign import Campaign
from estim.campaign.campaign_file import CampaignFile, Kind, NoiseTable, checked, read_campaign_file
from estim.campaign.design import load_design, simulate_campaign
from estim.campaign.unmodelled_force import as_complete
from estim.campaign.key_table import KeyTable
from estim.campaign.lookup_levels import body_levels
from estim.campaign.loading import load_campaign
from estim.campaign.curve_models import CurveModel
from estim.campaign.curve_tables import variable_of
from estim.campaign.new_campaign import columns_of, drafted_campaign
from estim.campaign.row_selection import way_back
from estim.campaign.table_campaign import TableChoices, campaign_of_table, choices_of_table, pairs
from estim.campaign.body_parts import OUTPUTS, PartedBody, correlations, known_to, notes_of
from estim.campaign.quantities import EFFECTS
from estim.campaign.planned_campaign import (
    NewRun,
    axis_columns,
    group_columns,
    otherwise,
    planned_quantities,
    quantity_of_key,
    with_own_gamma,
    with_runs,
    with_tables,
)
