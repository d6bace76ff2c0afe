"""Plans for every kind of measurement on arms that come as descriptions."""

import pytest

from tests.measured_cells import KINDS, URDFS, check_scatter, measured_cell, scatter_over_predicted

pytestmark = pytest.mark.real_data


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("arm", URDFS)
def test_parameters_scatter_as_predicted(arm, kind, data_folder):
    check_scatter(scatter_over_predicted(measured_cell(kind, arm, data_folder / "urdf")))
