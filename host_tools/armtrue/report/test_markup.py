"""Elements as text."""

from armtrue.report.markup import Markup, join, tag


def test_text_is_escaped_once_and_markup_never():
    inner = tag("b", "a < b & c")
    assert inner == "<b>a &lt; b &amp; c</b>"
    assert tag("p", inner, ["; ", None, Markup("<br>")]) == "<p><b>a &lt; b &amp; c</b>; <br></p>"


def test_attributes_are_quoted_and_left_out():
    made = tag("a", class_='x"y', aria_label="<1>", hidden=True, open=False, id=None)
    assert made == '<a class="x&quot;y" aria-label="&lt;1&gt;" hidden></a>'


def test_an_attribute_may_be_called_name():
    assert tag("input", name="step", type="radio") == '<input name="step" type="radio">'


def test_void_elements_of_svg_close_themselves():
    assert join(tag("path", d="M0 0"), tag("br")) == '<path d="M0 0"/><br>'
