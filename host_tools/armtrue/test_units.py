import pytest

from armtrue.units import figure, for_people, plural, value_and_sigma


@pytest.mark.parametrize(
    ("value", "unit", "shown", "name"),
    [
        (1e-4, "m", 100.0, "µm"),
        (-1.5e-3, "m", -1.5, "mm"),
        (1e-4, "rad", 20.6265, "″"),
        (0.01, "rad", 0.572958, "°"),
        (1.8e-6, "rad/Nm", 1.8, "µrad/Nm"),
        (2.36e-5, "1/K", 23.6, "µm/(m K)"),
        (5400.0, "s", 1.5, "h"),
        (3.1e-10, "rad/Nm^2", 0.31, "nrad/Nm²"),
        (1.2e-5, "m/h", 12.0, "µm/h"),
        (8.27e-5, "rad/rad", 82.7, "ppm"),
        (-1.65e-4, "m/m", -165.0, "ppm"),
        (8.1e-7, "m/N", 810.0, "nm/N"),
        (2.5e-4, "m/rad", 250.0, "µm/rad"),
        (2.5e-4, "rad/m", 250.0, "µrad/m"),
        (0.02, "rad/rad", 2.0, "%"),
        (3.0, "furlong", 3.0, "furlong"),
        (0.0, "m", 0.0, "µm"),
    ],
)
def test_value_is_shown_in_a_readable_unit(value, unit, shown, name):
    found, found_name = for_people(value, unit)
    assert found == pytest.approx(shown, rel=1e-5)
    assert found_name == name


@pytest.mark.parametrize(
    ("value", "sigma", "words"),
    [
        (1.2345e-4, 1.2e-6, ("123.5", "1.2", "µm")),
        (-2.5e-3, 4.56e-5, ("-2.500", "0.046", "mm")),
        (0.0, 2.9e-6, ("0.0", "2.9", "µm")),
        (1e-6, 2e-3, ("0.0", "2.0", "mm")),
        (1.2345e-4, None, ("123.5", "", "µm")),
    ],
)
def test_value_and_sigma_share_unit_and_number_of_decimals(value, sigma, words):
    assert value_and_sigma(value, sigma, "m") == words


def test_figures_beyond_nine_decimals_take_an_exponent_in_their_unit():
    assert value_and_sigma(-3.14e-12, 2e-14, "furlong") == ("-3.140e-12", "2.0e-14", "furlong")
    assert value_and_sigma(2.5e-3, 2e-14, "m") == ("2.500000000000e+00", "2.0e-11", "mm")


def test_figure_uses_an_exponent_only_for_large_numbers():
    assert figure(0.012345) == "0.01235"
    assert figure(123456.0) == "123456"
    assert figure(1.2e9) == "1.200e+09"
    assert figure(0.0) == "0"


@pytest.mark.parametrize(
    ("count", "word", "shown"),
    [(1, "row", "1 row"), (0, "row", "0 rows"), (2, "more row", "2 more rows")],
)
def test_count_has_its_word_in_singular_or_plural(count, word, shown):
    assert plural(count, word) == shown
