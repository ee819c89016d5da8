"""Hidden-effect cases: hidden effects are visible in the measurements, and no others are present."""

import numpy as np
import pytest

from .cases import KINDS, TRACKER_SIGMA, catalogue_choices, hidden_cases
from .errors import ScenarioError
from .kinds import PAIR_KINDS, PAIRS
from .sensitivity import geometry_terms, orthonormal_range, sensitivity, unexplained, unit_term

NOISE = np.sqrt(3.0) * TRACKER_SIGMA


@pytest.mark.quick("one_hidden-kr30", "outside_catalogue-kr30", "missing_columns-kr30", "gross_errors-kr30")
@pytest.mark.quick(
    "one_hidden-kr30",
    "three_hidden-kr30",
    "nothing_hidden-kr30",
    "outside_catalogue-kr30",
    "gross_errors-kr30",
    "missing_columns-kr30",
    "real_one-kr30",
    "later_hysteresis-kr30",
)
@pytest.mark.parametrize(
    ("kind", "arm"),
    [(kind, arm) for kind, given in KINDS.items() for arm in given.arms],
)
def test_hidden_effects_are_present_and_visible(kind, arm):
    for seed in range(1 if kind.startswith("later") else 2):
        case = hidden_cases(kind, arm, seed)
        assert len(case.hidden) == KINDS[kind].hidden
        names = [h.effect for h in case.hidden] or ["none"]
        assert [entry["effect"] for entry in case.campaign.hidden] == names
        for hidden in case.hidden:
            assert hidden.raw_rms >= 2.99 * NOISE
            assert hidden.visible_rms >= 0.99 * NOISE
            assert hidden.raw_rms < 2e-2
            assert (hidden.effect == "custom") == bool(hidden.variables)
        assert len(case.campaign.q) == (60 if "sixty_poses" in kind else 240)
        assert bool(case.campaign.gross_rows) == (kind == "gross_errors")
        withheld = [c for c in case.campaign.unrecorded if not c.startswith(("_", "travel", "duty"))]
        assert bool(withheld) == (kind == "missing_columns")


@pytest.mark.quick("open_backlash_2_or_joint_scale_2")
@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair.kind(0, False))
def test_pair_case_hides_one_cause_and_model_has_neither(pair):
    for hidden in (0, 1):
        for decides in (False, True) if pair.decides is not None else (False,):
            kind = pair.kind(hidden, decides)
            case = hidden_cases(kind, PAIR_KINDS[kind].arms[0], 0)
            suspect = pair.suspects[hidden]
            expected = suspect.joints or case.hidden[0].joints
            assert [(h.effect, h.joints) for h in case.hidden] == [(suspect.effect, expected)]
            assert case.hidden[0].visible_rms >= 0.99 * NOISE
            entries = [e if isinstance(e, dict) else {"effect": e} for e in case.believed]
            for other in pair.suspects:
                held = [e.get("joints", "all") for e in entries if e["effect"] == other.effect]
                assert not any(j == "all" or set(other.joints) <= set(j) for j in held)


def test_geometric_fit_leaves_the_hidden_effect_and_noise():
    """The case's `visible_rms`, computed again from the measured positions of the campaign."""
    for kind, expected in (("nothing_hidden", 0.0), ("one_hidden", None)):
        case = hidden_cases(kind, "kr30", 3)
        campaign = case.campaign
        arm = campaign.arm.with_terms(
            [t for t in campaign.arm.terms if t.effect in ("joint_offset", "link_geometry")]
        )
        terms = [*geometry_terms(arm), unit_term("motor2", "tau2"), unit_term("motor3", "tau3")]
        basis = orthonormal_range(sensitivity(arm, campaign.q, campaign.data, terms))
        left = unexplained(campaign.positions - arm.true_position(campaign.q, campaign.data), basis)
        variance = np.mean(np.sum(left**2, axis=1))
        visible = case.hidden[0].visible_rms if expected is None else expected
        assert np.sqrt(variance) == pytest.approx(np.hypot(visible, NOISE), rel=0.15)


def test_seeds_reproduce_and_differ():
    first, again, other = (hidden_cases("three_hidden", "irb2400", seed) for seed in (7, 7, 8))
    assert first.pairs == again.pairs
    assert np.array_equal(first.campaign.positions, again.campaign.positions)
    assert not np.array_equal(first.campaign.positions, other.campaign.positions)


@pytest.mark.full
def test_many_seeds_reach_the_whole_catalogue():
    seen = {h.effect for seed in range(60) for h in hidden_cases("three_hidden", "irb2400", seed).hidden}
    assert seen == set(catalogue_choices("irb2400"))
    shapes = {
        case.campaign.hidden[0]["name"]
        for case in (hidden_cases("outside_catalogue", "kr30", s) for s in range(60))
    }
    assert len(shapes) == 8


@pytest.mark.full
def test_noise_times_four_and_withheld_columns():
    case = hidden_cases("noise_x4", "cobot", 1)
    noise = case.campaign.positions - case.campaign.exact
    assert noise.std() == pytest.approx(4 * TRACKER_SIGMA, rel=0.1)
    for seed in range(40):
        case = hidden_cases("missing_columns", "kr30", seed)
        if case.untestable:
            assert case.untestable == ("backlash",)
            assert "dir1" not in case.campaign.data
            assert case.pairs[0][0] == "backlash"
            break
    else:
        pytest.fail("no seed withholds the column of its hidden effect")


@pytest.mark.full
def test_true_model_adds_the_hidden_effects_to_the_believed():
    for seed in range(20):
        case = hidden_cases("three_hidden", "irb2400", seed)
        added = case.true_model["effects"][len(case.believed) :]
        assert [e if isinstance(e, str) else e["effect"] for e in added] == [
            effect for effect, _ in case.pairs
        ]
        assert all(isinstance(e, str) or e["joints"] for e in added)
    foreign = hidden_cases("outside_catalogue", "kr30", 1).true_model["effects"][-1]
    assert set(foreign) == {"effect", "name", "coordinate", "expression"}
    nothing = hidden_cases("nothing_hidden", "cobot", 2)
    assert nothing.true_model["effects"] == nothing.believed


def test_unknown_kind_and_arm_are_named():
    with pytest.raises(ScenarioError, match="kind of case is 'easy'"):
        hidden_cases("easy", "kr30", 0)
    with pytest.raises(ScenarioError, match="arm is 'puma'"):
        hidden_cases("one_hidden", "puma", 0)
