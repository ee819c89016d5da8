"""Every form of expression, evaluated by the firmware and compared with NumPy; and those that are refused."""

from __future__ import annotations

import numpy as np
import pytest

from armtrue.errors import InputError
from armtrue.tables import export, expression, fitted_arm
from armtrue.tables.builder import Builder
from armtrue.tables.compiler import Compiler
from armtrue.tables.conftest import Worst, document
from armtrue.tables.export import ExportOptions
from armtrue.tables.gravity_sets import GravitySets
from armtrue.tables.image import Image
from armtrue.tables.layout import Node, Section, State

# 5 nrad: 15 nm at 3 m, some units of the last place.
EXACT = 5e-9


@pytest.mark.parametrize(
    "text",
    [
        "1", "q1", "th2", "q1*q2", "q1^2 - 3*q3 + 0.5", "q1^3/10", "-q2**2", "q1/(q2 + 4)", "1/(2 + sin(q1))",
        "sin(q1)", "cos(3*q2)", "sin(2*q1 - q3 + 0.3)", "cos(th2 + th3)", "sin(121.4*q3 + 1)", "tan(q1/4)",
        "sin(q1^2)", "abs(q1)", "sign(q2)*q2", "min(q1, q2)", "max(q1, -0.3)", "abs(min(sin(q1), 0.2))",
        "dT", "dT_air", "dT_arm*sin(q1)", "payload", "payload*cos(q2)", "dir1", "dir2*q1",
        "exp(-time/1800)", "1 - exp(-time/600)", "exp(q1/3)", "tanh(2*q1)", "time/100000",
        "tau2", "tau2*abs(tau2)/1000", "tau2^3/1e6", "gmx1", "gmy2", "bmx", "bmy", "sign(tau3)*tau3",
        "u_2_3_m", "u_2_3_x", "ux_2_3_m", "uy_2_3_z", "ux_0_1_y", "up_2*payload", "upx_3", "u_2_2_x*sin(q1)",
        "hat(q1, -1, 0, 2)", "hat(q2, 0, 0, 1)", "hat(q1, -1, 0.5, 1)*hat(q2, -1, 0, 1)", "hat(sin(q1), -0.5, 0, 0.5)",
    ],
)  # fmt: skip
def test_compiled_expressions_match_numpy(text: str, worst_error: Worst) -> None:
    # tau2 is some hundred newton-metres.
    size = 1e-6 if any(name in text for name in ("tau", "gm", "bm", "u_", "ux_", "uy_", "up")) else 1e-4
    size *= 10.0 if text.startswith("u") else 1.0
    tolerance = EXACT + (1e-8 if "hat" in text else 0.0)  # values of a hat function have 14 bits
    assert worst_error([("motor2", text, size)]) < tolerance


@pytest.mark.parametrize(
    "text",
    ["sqrt(1 + q1^2)", "sqrt(q1 + 4)", "atan(2*q2)", "asin(q1/4)", "acos(sin(q1)/2)", "log(q1 + 5)", "(q1 + 4)^1.5",
     "sin(q2 + 0.3)/sqrt(1 + 0.4^2 - 2*0.4*cos(q2 + 0.3))", "atan2(sin(q1), 2 + cos(q1))",
     "sqrt(3 + sin(q1) + cos(q2))"],
)  # fmt: skip
def test_function_without_a_node_becomes_an_accurate_table(text: str, worst_error: Worst) -> None:
    assert worst_error([("motor2", text, 1e-4)]) < 2e-8


@pytest.mark.parametrize(
    "text",
    [
        "exp(-q1*q1)", "exp(-(q1-1)*(q1-1))", "exp(-3*q1*q1)", "exp(q1/4*(-q1))", "exp(-(q1*q2)*(q1*q2))",
        "exp(-q1*q2*q1*q2)", "exp(-q1^4)", "exp(-q1*q1*q1*q1)", "exp(-(2*q1)*q1^2*q1/9)", "exp(-q1^2*q1^2/3)",
        "exp(-sin(q1)*sin(q1)*40)", "exp(-(q1^2)^2)",
    ],
)  # fmt: skip
def test_product_of_equal_factors_is_known_to_have_one_sign(text: str, worst_error: Worst) -> None:
    """None of these grows beyond 1; with factors that could differ in sign most would pass 2^30, ten rad from zero."""
    assert worst_error([("motor2", text, 1e-4)], limits=(-6.0, 6.0)) < EXACT


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("q1*q1", 0.0, 9.0), ("-q1*q1", -9.0, 0.0), ("q1*q1*q1", -1.0, 27.0), ("q1^3", -1.0, 27.0),
        ("q1*q1*q1*q1", 0.0, 81.0), ("q1^4", 0.0, 81.0), ("q1^2*q1", -1.0, 27.0), ("q1*q1*2*q1^2", 0.0, 162.0),
        ("(q1+3)*(q1+3)", 4.0, 36.0), ("(q1-4)^2", 1.0, 25.0), ("(q1-4)^3", -125.0, -1.0), ("q1*q2*q1", -18.0, 18.0),
        ("-q1*q2*q1*q2", -36.0, 0.0), ("q1*q2", -6.0, 6.0), ("q1*(q1+1)", -4.0, 12.0), ("q1*(-q1)/2", -4.5, 0.0),
    ],
)  # fmt: skip
def test_range_of_a_power_follows_from_the_range_of_its_base(text: str, low: float, high: float) -> None:
    ranges = {"q1": (-1.0, 3.0), "q2": (-2.0, 2.0)}
    builder = Builder()
    compiler = Compiler(
        builder, lambda name: builder.state(State.MOTOR, int(name[1:]) - 1, *ranges[name]), lambda _: None
    )
    value = compiler.compile(expression.parse(text), 1.0)
    assert (value.low, value.high) == (low, high)


@pytest.mark.parametrize("text", ["exp(q1*q1)", "exp(-q1*q2)", "exp(q1*q1*q1)"])
def test_exponential_that_grows_is_refused(text: str) -> None:
    fit = document([("motor2", text, 1e-4)])
    for joint in fit["robot"]["kinematics"]["joints"]:
        joint["limits"] = [-6.0, 6.0]
    with pytest.raises(InputError, match="grows beyond"):
        export(fitted_arm(fit, "fit.json"), ExportOptions())


def test_function_of_two_variables_becomes_a_grid_with_a_note() -> None:
    arm = fitted_arm(document([("motor2", "atan2(1 + 0.3*q1, 3 + 0.2*q2)", 2e-5)]), "test")
    made = export(arm, ExportOptions())
    assert any("became a table" in note and "error at most" in note for note in made.notes)
    assert Image(made.image).grids()[0].values.shape[:2] >= (9, 9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sqrt(abs(q1))", "wrong by more than"),
        ("atan2(q1*q2*q3, tau2)", "4 variables"),
        ("exp(time)", "grows beyond"),
        ("sin(3000*q1)", "cycles a turn"),
        ("q1*1e6", "more than 0.5"),
        ("qr1", "a device does not know 'qr1'"),
    ],
)
def test_expression_that_cannot_be_represented_is_refused(text: str, words: str) -> None:
    arm = fitted_arm(document([("motor2", text, 1.0)]), "fit.json")
    with pytest.raises(InputError, match=words) as caught:
        export(arm, ExportOptions(), "fit.json")
    assert str(caught.value).startswith("fit.json: cannot be exported")


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        ([("motor2", "sin(q1)", 0.6)], "a wave of 0.6 on motor2, more than 0.5"),
        ([("motor2", "q1*1e6", 1.0)], "more than 0.5"),
        ([("link1.tx", "payload*u_2_3_m*1e9", 1.0)], "more than 0.5"),
    ],
)
def test_too_large_term_is_refused_with_effect_and_remedy(
    terms: list[tuple[str, str, float]], words: str
) -> None:
    arm = fitted_arm(document(terms), "fit.json")
    with pytest.raises(InputError) as caught:
        export(arm, ExportOptions(), "fit.json")
    assert str(caught.value).startswith(
        f"fit.json: cannot be exported: effect custom, a term on {terms[0][0]}: "
    )
    assert words in str(caught.value)
    assert "armtrue remove" in str(caught.value)


def test_too_large_sum_of_regressors_names_its_coordinate() -> None:
    arm = fitted_arm(document([("motor2", "u_2_3_m", 1.0)]), "fit.json")
    with pytest.raises(InputError, match=r"gravity regressors on motor2: .*armtrue remove"):
        export(arm, ExportOptions(), "fit.json")


# The first axis is vertical: gravity makes no torque on it, and double precision leaves 1e-15.
@pytest.mark.quick(
    "payload*({} + q2)-tau1", "payload*{}-u_1_3_m", "sin(q2)*{}*payload-up_1", "{0}*abs({0})-u_1_2_x"
)
@pytest.mark.parametrize("zero", ["tau1", "u_1_2_x", "u_1_3_m", "up_1"])
@pytest.mark.parametrize("form", ["payload*{}", "{0}*abs({0})", "sin(q2)*{}*payload", "payload*({} + q2)"])
def test_gravity_load_that_is_only_rounding_counts_as_zero(zero: str, form: str, worst_error: Worst) -> None:
    beside = ("motor2", "payload*u_2_3_x", 1e-6)
    assert worst_error([beside, ("motor2", form.format(zero), 1e-6)]) < EXACT
    with_zero = export(
        fitted_arm(document([beside, ("motor2", f"payload*{zero}", 1e-6)]), "t"), ExportOptions()
    )
    without = export(fitted_arm(document([beside]), "t"), ExportOptions())
    sections = [Image(made.image).count(Section.TERMS) for made in (with_zero, without)]
    assert sections[0] == sections[1]


def test_gravity_load_on_an_axis_tilted_by_1_urad_is_kept(worst_error: Worst) -> None:
    gravity = [9.81e-6, 0.0, -9.81]
    assert worst_error([("motor2", "payload*u_1_3_x", 1e-2)], gravity=gravity) < 2e-8


def test_largest_gravity_torque_fills_30_bits_of_the_device() -> None:
    """1 kg in joint 3, at most 1.108 m from the base: 10.9 Nm."""
    sets = GravitySets(fitted_arm(document([]), "t").chain, np.zeros(3), payload_max_kg=0.0)
    sets.combined({"u_1_3_m": 1.0})
    sets.choose_fractions()
    assert 2.0**29 < 9.81 * 1.108 * 2.0 ** sets.sets[0].fraction < 2.0**30


def test_payload_terms_are_left_out_if_its_maximum_is_zero() -> None:
    arm = fitted_arm(document([("motor2", "payload*tau2", 1e-8), ("motor2", "q2", 1e-4)]), "t")
    image = Image(export(arm, ExportOptions(payload_max_kg=0.0)).image)
    assert image.count(Section.TERMS) == 1


def test_gravity_torque_without_masses_is_refused() -> None:
    arm = fitted_arm(document([("motor2", "tau2", 1e-6)], links=[]), "fit.json")
    with pytest.raises(InputError, match="gives no masses"):
        export(arm, ExportOptions())


def test_regressors_of_one_spring_become_one_mass_set(worst_error: Worst) -> None:
    terms = [
        ("motor2", f"u_2_{link}_{c}", 1e-6 * (i + 1))
        for i, (link, c) in enumerate([(2, "x"), (2, "z"), (3, "m"), (3, "y")])
    ]
    assert worst_error(terms, links=[]) < EXACT
    image = Image(export(fitted_arm(document(terms, links=[]), "test"), ExportOptions()).image)
    assert image.count(Section.MASS_SETS) == 1


def test_waves_of_one_order_become_one_record() -> None:
    terms = [
        ("motor3", "sin(17*q3)", 3e-5),
        ("motor3", "cos(17*q3)", -4e-5),
        ("motor3", "sin(17*q3 + 1)", 1e-5),
    ]
    image = Image(export(fitted_arm(document(terms), "test"), ExportOptions()).image)
    ((coordinate, variable, order, phase, amplitude),) = image.harmonics()
    assert (coordinate, variable, order) == ("motor3", "q3", 17.0)
    q = np.linspace(-2.0, 2.0, 100)
    exact = 3e-5 * np.sin(17 * q) - 4e-5 * np.cos(17 * q) + 1e-5 * np.sin(17 * q + 1)
    assert np.abs(amplitude * np.sin(17 * q + phase) - exact).max() < 1e-9


def test_common_subexpression_is_computed_once() -> None:
    terms = [("motor1", "q1*q2 + 1", 1e-4), ("motor3", "2*q1*q2", 1e-4), ("link2.tx", "(q1*q2)*0.5", 1e-4)]
    image = Image(export(fitted_arm(document(terms), "test"), ExportOptions()).image)
    assert sum(node[0] is Node.PRODUCT for node in image.nodes()) == 1


def test_like_terms_are_summed_and_zero_terms_left_out() -> None:
    terms = [("motor1", "q1", 1e-4), ("motor1", "2*q1", 1e-4), ("motor2", "q2", 0.0)]
    image = Image(export(fitted_arm(document(terms), "test"), ExportOptions()).image)
    ((coordinate, _, _),) = image.terms()
    assert coordinate == "motor1"


def test_expressions_match_on_a_coupled_arm(worst_error: Worst) -> None:
    coupled = {"coupling": [{"joint": 3, "driving": 2, "ratio": -1.0}]}
    for text in ("tau2/1000", "sin(th3)", "sin(2*q3)", "th3"):
        assert worst_error([("motor3", text, 1e-4)], "motor3", **coupled) < EXACT
