"""HTML and SVG elements written as text."""

from armtrue.report.markup import Markup, join, tag
from armtrue.report.parts import fixed, rounded, typeset


def test_text_is_escaped_once_and_markup_is_not():
    inner = tag("b", "a < b & c")
    assert inner == "<b>a &lt; b &amp; c</b>"
    assert tag("p", inner, ["; ", None, Markup("<br>")]) == "<p><b>a &lt; b &amp; c</b>; <br></p>"


def test_attributes_are_escaped_and_empty_ones_omitted():
    made = tag("a", class_='x"y', aria_label="<1>", hidden=True, open=False, id=None)
    assert made == '<a class="x&quot;y" aria-label="&lt;1&gt;" hidden></a>'


def test_an_attribute_may_be_called_name():
    assert tag("input", name="step", type="radio") == '<input name="step" type="radio">'


def test_void_elements_of_svg_close_themselves():
    assert join(tag("path", d="M0 0"), tag("br")) == '<path d="M0 0"/><br>'


def test_names_have_long_periods_rounded_and_short_ones_kept():
    assert rounded("gear_mesh[1].sin192.55173045837515c") == "gear_mesh[1].sin192.55c"
    assert rounded("link_geometry[2].tx 0.125 v1.2.3") == "link_geometry[2].tx 0.125 v1.2.3"


def test_ascii_signs_and_units_are_typeset():
    assert typeset("rises by 41 arcsec (log10 p -232.7), 12.5 um -> 3 um") == (
        "rises by 41″ (log10 p −232.7), 12.5 µm → 3 µm"
    )


def test_value_that_rounds_to_zero_has_no_sign():
    assert [fixed(value, 1) for value in (-0.04, 0.04, -0.06, 12.25)] == ["0.0", "0.0", "−0.1", "12.2"]
    assert fixed(-0.4, 0) == "0"
