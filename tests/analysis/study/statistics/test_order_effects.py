import pandas as pd
import pytest

from haptigraph.analysis.study.quantities import QUANTITIES
from haptigraph.analysis.study.statistics.order_effects import MixedModel, fit_mixed, order_effects
from haptigraph.analysis.study.statistics.sensitivity import paired_t

# ErgoStool: effort of nine subjects to arise from four stools; Pinheiro & Bates (2000), section 1.2.
STOOLS = [
    (12, 15, 12, 10), (10, 14, 13, 12), (7, 14, 13, 9), (7, 11, 10, 9), (8, 11, 8, 7), (9, 11, 11, 10),
    (8, 12, 12, 11), (7, 11, 8, 7), (9, 13, 10, 8),
]  # fmt: skip
THETA = QUANTITIES[1]


def stools() -> pd.DataFrame:
    rows = [(who, f"T{kind}", effort) for who, row in enumerate(STOOLS) for kind, effort in enumerate(row, 1)]
    return pd.DataFrame(rows, columns=["participant", "type", "effort"])


def crossover(participants: int, trials: int = 4, targets: int = 4, conditions: str = "ab") -> pd.DataFrame:
    """Deterministic values in a cross-over study: large differences between targets, touch (b) 1 lower."""
    rows = []
    for who in range(participants):
        order = [conditions[(who + step) % len(conditions)] for step in range(len(conditions))]
        for position, condition in enumerate(order, 1):
            for trial in range(1, trials + 1):
                target = (who + trial + position) % targets
                noise = (who * 7 + trial * 11 + position * 5 + who * trial * 3) % 13 / 6
                theta = 8 - (condition == "b") + 2 * target + who % 5 + noise
                rows.append((f"P{who}", condition, position, trial, f"t{target}", theta))
    columns = ["participant", "condition", "position", "trial", "target", "mean_theta_deg"]
    return pd.DataFrame(rows, columns=columns)


def model_of(frame: pd.DataFrame, conditions: str = "ab") -> MixedModel:
    found = order_effects(frame, THETA, list(conditions))
    assert isinstance(found, MixedModel), found
    return found


def terms_of(frame: pd.DataFrame, conditions: str = "ab"):
    return {term.name: term for term in model_of(frame, conditions).terms}


def test_a_balanced_model_agrees_with_pinheiro_and_bates():
    model = fit_mixed(stools(), "effort ~ type")
    estimates = [term.estimate for term in model.terms]
    assert estimates == pytest.approx([77 / 9, 35 / 9, 20 / 9, 6 / 9], abs=1e-6)
    assert model.terms[1].error == pytest.approx(0.5186838, abs=1e-6)
    assert [term.df for term in model.terms] == pytest.approx([15.52981, 24, 24, 24], rel=1e-4)  # lmerTest
    assert model.participant_sd == pytest.approx(1.332465, abs=2e-6)
    assert model.residual_sd == pytest.approx(1.100295, abs=2e-6)
    assert model.remark == "" and (model.runs, model.participants) == (36, 9)


def test_an_unbalanced_model_agrees_with_lmertest():
    # R 4.2, lmerTest 3.1-3: summary(lmer(effort ~ type + (1 | participant), data)), four rows left out
    model = fit_mixed(stools().drop(index=[1, 7, 20, 33]), "effort ~ type")
    expected = [
        (8.500302034, 0.5788260143, 17.95672040, 14.6854181118, 1.905243035e-11),
        (3.658864350, 0.6112459012, 20.63299557, 5.9859122875, 6.564485774e-06),
        (2.277475744, 0.5632676269, 20.18772081, 4.0433279591, 6.257810653e-04),
        (0.553349234, 0.5846636734, 20.39356368, 0.9464402513, 3.550042940e-01),
    ]
    for term, row in zip(model.terms, expected, strict=True):
        assert (term.estimate, term.error, term.df, term.t, term.p) == pytest.approx(row, rel=1e-4)
    assert model.terms[1].low == pytest.approx(3.658864 - 2.081796 * 0.6112459, rel=1e-4)  # qt(0.975, 20.633)


def test_the_model_of_a_crossover_with_targets_agrees_with_lmertest():
    # R: lmer(value ~ condition + position + target + trial + sequence + (1 | participant))
    found = terms_of(crossover(9).drop(index=[3, 17, 40, 41, 55]))
    for name, t, df in (
        ("condition[T.b]", -8.6962114861, 52.043156830),
        ("position", 1.4634534588, 52.037050957),
        ("target[T.t3]", 28.9102047494, 52.006756260),
        ("trial", -0.1303770758, 52.030254995),
        ("sequence[T.b]", -0.6779379796, 6.998210273),
    ):
        assert (found[name].t, found[name].df) == pytest.approx((t, df), rel=1e-3)


def test_the_effect_of_touch_emerges_when_the_target_is_in_the_model():
    study = crossover(9)
    without = terms_of(study.drop(columns="target"))["condition[T.b]"]
    assert abs(terms_of(study)["condition[T.b]"].t) > 3 * abs(without.t)


def test_with_two_conditions_the_model_is_the_paired_t_test():
    frame = stools()
    frame = frame[frame["type"].isin(["T1", "T3"])]
    term = fit_mixed(frame, "effort ~ type").terms[1]
    paired = paired_t(*([row[kind] for row in STOOLS] for kind in (0, 2)))
    found = (term.t, term.df, term.p, term.low, term.high)
    assert found == pytest.approx((paired.t, paired.df, paired.p, paired.low, paired.high), rel=1e-4)


def test_without_variance_between_participants_the_degrees_of_freedom_are_those_of_ordinary_regression():
    frame = stools().assign(participant=[row % 9 for row in range(36)])
    model = fit_mixed(frame.assign(effort=[(row * 5) % 7 for row in range(36)]), "effort ~ type")
    assert "at or near zero" in model.remark and {term.df for term in model.terms} == {32.0}


def test_carry_over_of_more_than_two_conditions_is_that_of_the_condition_before():
    model = model_of(crossover(12, trials=2, conditions="abc"), "abc")
    assert model.formula == "value ~ condition + position + target + trial + after"
    assert {"after[T.b]", "after[T.c]"} <= {term.name for term in model.terms}


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (crossover(8).assign(position=lambda t: t["condition"].map({"a": 1, "b": 2})), "in the same order"),
        (crossover(2), "2 participants are too few: no ranks of so few reach p < 0.05"),
        (
            crossover(8).assign(target=lambda t: "of " + t["condition"]),
            "condition cannot be separated from target (of a only under a; of b only under b)",
        ),
        (crossover(1), "only one participant has values"),
        (crossover(6).assign(mean_theta_deg=7.0), "all values are equal"),
        (crossover(6).assign(position=float("nan")), "no participant has values and positions of two"),
        (crossover(6).query("position == 1"), "no participant has values and positions of two"),
    ],
    ids=[
        "fixed order",
        "two people",
        "confounded",
        "one person",
        "constant",
        "no position",
        "one condition each",
    ],
)
def test_the_reason_is_given_where_there_is_no_model(frame, reason):
    found = order_effects(frame, THETA, ["a", "b"])
    assert isinstance(found, str) and reason in found


def test_a_factor_that_is_left_out_is_named_with_the_reason():
    assert model_of(crossover(8)).dropped == ()
    frame = crossover(8).assign(target=lambda t: "at " + t["position"].astype(str))
    model = model_of(frame)
    assert "target" not in model.formula
    assert model.dropped == ("target, as it cannot be separated from condition, position",)
    frame.loc[frame.index[0], "target"] = None
    assert model_of(frame).dropped == ("target, as some runs have none",)
