"""The report in Debian's Chromium: on a laptop, on a phone, in the dark, on paper, by keyboard and by touch."""

from __future__ import annotations

import http.server
import json
import re
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest
from armtrue import Fit, add, diagnose
from armtrue.report import write
from armtrue.report.gathered.steps import steps_of
from armtrue.report.page import document
from armtrue.report.pictures.arm import scene
from armtrue.report.sections.residual_sections import viewer
from browser import A4, LAPTOP, PHONE, Browser
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

# The quick level has one test with a browser, tests/workbench/test_flow.py.
pytestmark = pytest.mark.full

ARROWS = """return ['length0', 'length1', 'length2', 'length3']
    .map(k => document.querySelector('.stage .' + k).getAttribute('d')).join('')"""
# Contrast of every element's own text against what is painted behind it (WCAG 2.1, relative luminance).
CONTRAST = """
const channel = (c) => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
const parse = (text) => text.match(/[\\d.]+/g).map(Number);
const light = ([r, g, b]) => 0.2126 * channel(r) + 0.7152 * channel(g) + 0.0722 * channel(b);
function behind(element) {
  for (let e = element; e; e = e.parentElement) {
    const colour = parse(getComputedStyle(e).backgroundColor);
    if (colour.length < 4 || colour[3] > 0) return colour;
  }
  return [255, 255, 255];
}
const poor = [];
for (const element of document.querySelectorAll('body *')) {
  const own = [...element.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
  if (!own || ['SCRIPT', 'STYLE', 'TITLE', 'NOSCRIPT'].includes(element.tagName.toUpperCase())) continue;
  if (!element.checkVisibility()) continue;
  const style = getComputedStyle(element);
  const ink = light(parse(element instanceof SVGElement ? style.fill : style.color)), paper = light(behind(element));
  const ratio = (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
  const name = `${element.tagName}.${element.getAttribute('class')}`;
  if (ratio < 4.5) poor.push(`${name} ${ratio.toFixed(2)}: ${element.textContent}`);
}
return [...new Set(poor)];
"""
# Smallest font size of every visible chart, in CSS pixels.
HEIGHTS = """
const charts = [...document.querySelectorAll('.panel, .stage svg')].filter((svg) => svg.checkVisibility());
return charts.map((svg) => {
  const scale = svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
  const sizes = [...svg.querySelectorAll('text')].map((text) => parseFloat(getComputedStyle(text).fontSize));
  return scale * Math.min(...sizes);
});
"""


FETCH = """
    const [address, done] = arguments;
    fetch(address, {mode: "no-cors"}).then(() => done("answered"), () => done("refused"));
"""


@pytest.fixture
def laptop(browser: Browser, page: Path) -> Browser:
    browser.open(page)
    return browser


def arrows(browser: Browser) -> str:
    browser.settle()
    return str(browser.run(ARROWS))


def stage(browser: Browser):
    element = browser.driver.find_element(By.CSS_SELECTOR, ".stage")
    browser.run("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", element)
    return element


def test_report_loads_offline_without_console_messages(laptop):
    assert laptop.complaints() == []
    assert laptop.run("return performance.getEntriesByType('resource').length") == 0
    assert laptop.run("return document.title") == "Calibration of kr30"
    # (navigator.onLine does not report this in every version.)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        asked = laptop.driver.execute_async_script(FETCH, f"http://127.0.0.1:{server.server_address[1]}/")
        server.shutdown()
    assert asked == "refused", "the window has a network"
    laptop.complaints()  # drops the message about this request


@pytest.mark.parametrize("size", [LAPTOP, PHONE, (320, 640), (820, 1180)], ids=str)
def test_page_is_not_wider_than_the_window(browser, page, size):
    browser.open(page, size)
    wide = "return [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
    scrolled, shown = browser.run(wide)
    assert scrolled <= shown == size[0]


@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_chart_text_is_at_least_12_pixels_high(browser, page, size):
    browser.open(page, size)
    heights = browser.run(HEIGHTS)
    assert len(heights) > 20
    assert min(heights) >= 12.0


@pytest.mark.parametrize(
    ("size", "media"), [(LAPTOP, ""), (PHONE, ""), (A4, "print")], ids=["laptop", "phone", "paper"]
)
def test_chart_ticks_do_not_overlap_axis_names(browser, page, size, media):
    browser.open(page, size, media=media)
    struck = browser.run("""
        const charts = [...document.querySelectorAll('.panel:has(.axis-name)')];
        return charts.filter((chart) => chart.checkVisibility()).flatMap((chart) => {
            const name = [...chart.querySelectorAll('.axis-name')].at(-1).getBoundingClientRect();
            return [...chart.querySelectorAll('.ticks')].filter((tick) => {
                const words = tick.getBoundingClientRect();
                return words.left < name.right && words.top < name.bottom && words.bottom > name.top;
            }).map((tick) => `${chart.ariaLabel}: ${tick.textContent}`);
        })""")
    assert struck == []


@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_chart_text_ends_inside_its_chart(browser, page, size):
    browser.open(page, size)
    cut = browser.run("""
        return [...document.querySelectorAll('.panel text')].filter((t) => t.checkVisibility()).filter((t) => {
            const words = t.getBoundingClientRect(), chart = t.closest('.panel').getBoundingClientRect();
            return words.left < chart.left - 1 || words.right > chart.right + 1
                || words.top < chart.top - 1 || words.bottom > chart.bottom + 1;
        }).map((t) => t.textContent)""")
    assert cut == []


def test_axes_state_their_unit_and_logarithmic_scale(laptop):
    plots = laptop.run("return [...document.querySelectorAll('[data-plot]')].map((e) => e.dataset.plot)")
    axes = [(axis, json.loads(plot)[axis]) for plot in plots for axis in ("x", "y")]
    assert len(axes) > 100
    for _, axis in axes:
        assert axis["name"].endswith(", logarithmic") == axis["logarithmic"]
    # Counts, and directions of −1, 0 or 1, have no unit.
    bare = {axis["name"] for _, axis in axes if "[" not in axis["name"]}
    bare = {
        name
        for name in bare
        if not re.match(r"direction joint \d came from|cycles a turn of joint \d|poses$", name)
    }
    assert bare == set()
    assert "µm, logarithmic" in laptop.run("return document.querySelector('.waterfall-axis').textContent")


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_text_contrast_is_at_least_4_5(browser, page, dark):
    browser.open(page, dark=dark)
    background = browser.run("return getComputedStyle(document.documentElement).backgroundColor")
    red = int(re.findall(r"\d+", background)[0])
    assert red < 60 if dark else red > 240
    assert browser.run(CONTRAST) == []


@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_candidate_figures_and_captions_are_inside_the_window(browser, page, size):
    browser.open(page, size)
    ends = browser.run("""
        const shown = [...document.querySelectorAll('.stacked th, .stacked td, caption span')]
            .filter((e) => e.checkVisibility());
        return shown.map((e) => [e.textContent, e.getBoundingClientRect().left, e.getBoundingClientRect().right])""")
    assert len(ends) > 50
    assert [end for end in ends if end[1] < 0 or end[2] > size[0]] == []
    cut = "return [...document.querySelectorAll('.stacked')].every((t) => t.scrollWidth <= t.clientWidth)"
    assert browser.run(cut)


@pytest.mark.parametrize("width", [1280, 820], ids=["laptop", "tablet"])
def test_tables_of_the_error_need_no_scrolling_on_a_laptop(browser, page, width):
    browser.open(page, (width, 800))
    long_name = """document.querySelectorAll('#error tbody th').forEach((e) => {
        e.textContent = 'step 2: + command_readback [2, 3]';
    })"""
    browser.run(long_name)
    beyond = (
        "return [...document.querySelectorAll('#error .scroll')].map((e) => e.scrollWidth - e.clientWidth)"
    )
    assert browser.run(beyond) == [0, 0]


@pytest.mark.parametrize("size", [LAPTOP, (800, 900)], ids=["laptop", "tablet"])
def test_head_of_the_page_is_whole(browser, page, size):
    """The summary has no empty tile, the menu shows every section, and names of steps break between words alone."""
    browser.open(page, size)
    tiles, menu, broken = browser.run("""
        const area = (e) => e.clientWidth * e.clientHeight;
        const tiles = [...document.querySelectorAll('dl div')].reduce((sum, e) => sum + area(e), 0);
        const menu = document.querySelector('nav ul');
        const broken = [...document.querySelectorAll('.step strong')].flatMap((e) => {
            const node = e.firstChild, range = document.createRange();
            return [...node.data.matchAll(/\\S+/g)].filter((word) => {
                range.setStart(node, word.index);
                range.setEnd(node, word.index + word[0].length);
                return range.getClientRects().length > 1;
            }).map((word) => word[0]);
        });
        return [tiles / area(document.querySelector('dl')), menu.scrollWidth - menu.clientWidth, broken]""")
    assert tiles > 0.97
    assert menu <= 0
    assert broken == []


@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_legend_of_the_arrows_does_not_overlap_them(browser, page, size):
    browser.open(page, size)
    stage(browser)
    browser.settle()
    bottoms, right, top = browser.run("""
        const words = [...document.querySelectorAll('.stage .entry')].map((e) => e.getBBox());
        const drawn = ['start', 'arm'].map((k) => document.querySelector('.stage .' + k).getBBox().y);
        return [words.map((b) => b.y + b.height), Math.max(...words.map((b) => b.x + b.width)), Math.min(...drawn)]""")
    assert len(bottoms) == 4
    assert max(bottoms) <= top
    assert right <= size[0] - 30


def test_arrow_lengths_match_the_horizontal_errors(laptop, fits):
    """Seen from above, an arrow is as long as its horizontal error at the scale that the ruler states."""
    stage(laptop).send_keys("1")
    strokes = re.findall(r"M(-?[\d.]+) (-?[\d.]+)L(-?[\d.]+) (-?[\d.]+)", arrows(laptop))
    drawn = [np.hypot(float(x1) - float(x0), float(y1) - float(y0)) for x0, y0, x1, y1 in strokes]
    text = laptop.run(
        "return [...document.querySelectorAll('.stage text')].map((t) => t.textContent).join('|')"
    )
    micrometres = float(re.search(r"error of ([\d.]+) µm", text)[1])
    ruler = laptop.run("return document.querySelector('.ruler').getAttribute('d')")
    pixels = float(re.search(r"h-([\d.]+)", ruler)[1])
    expected = np.sort(np.hypot(*fits[-1].residuals()[:, :2].T) * 1e6 * pixels / micrometres)
    # The longest strokes are shafts; the strokes of heads are shorter. Arrows of gross errors are shortened to fit.
    drawn.sort()
    gross = len(fits[-1].document["rejected"])
    assert gross >= 3
    assert np.array(drawn[-40:-gross]) / expected[-40:-gross] == pytest.approx(1.0, abs=0.03)
    room = laptop.run("return document.querySelector('.stage').clientHeight")
    assert max(drawn) < room < expected[-gross]
    starts = laptop.run("return document.querySelector('.start').getAttribute('d').split('M').length - 1")
    assert starts == len(expected)


@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_every_arrow_ends_inside_the_picture(browser, page, size):
    browser.open(page, size)
    stage(browser)
    browser.settle()
    width, height = browser.run(
        "const e = document.querySelector('.stage svg').viewBox.baseVal; return [e.width, e.height]"
    )
    ends = np.array(
        [[float(v) for v in end] for end in re.findall(r"L(-?[\d.]+) (-?[\d.]+)", arrows(browser))]
    )
    assert len(ends) > 200
    assert np.all((ends > -1) & (ends < [width + 1, height + 1]))


@pytest.mark.parametrize(
    "key", [Keys.ARROW_LEFT, Keys.ARROW_UP, "+", "2", "]"], ids=["left", "up", "plus", "2", "]"]
)
def test_keys_move_the_view_and_0_resets_it(laptop, key):
    view = stage(laptop)
    before = arrows(laptop)
    view.send_keys(key)
    assert arrows(laptop) != before
    view.send_keys("0")
    assert arrows(laptop) == before


def test_mouse_drag_turns_and_wheel_zooms_the_view(laptop):
    view = stage(laptop)
    before = arrows(laptop)
    ActionChains(laptop.driver).click_and_hold(view).move_by_offset(90, 30).release().perform()
    turned = arrows(laptop)
    assert turned != before
    ActionChains(laptop.driver).scroll_from_origin(ScrollOrigin.from_element(view), 0, -300).perform()
    assert arrows(laptop) != turned


def test_touch_turns_and_pinch_zooms_the_view(browser, page):
    browser.open(page, PHONE)
    view = stage(browser)
    box = browser.run(
        "const b = arguments[0].getBoundingClientRect(); return [b.x, b.y, b.width, b.height]", view
    )
    x, y = box[0] + box[2] / 2, box[1] + box[3] / 2

    def touch(kind: str, *points: tuple[float, float]) -> None:
        touches = [{"x": px, "y": py, "id": k} for k, (px, py) in enumerate(points)]
        browser.command("Input.dispatchTouchEvent", type=kind, touchPoints=touches)

    before = arrows(browser)
    touch("touchStart", (x, y))
    touch("touchMove", (x + 60, y + 10))
    touch("touchEnd")
    turned = arrows(browser)
    assert turned != before
    touch("touchStart", (x - 20, y), (x + 20, y))
    touch("touchMove", (x - 80, y), (x + 80, y))
    touch("touchEnd")
    width = "const b = document.querySelector('.stage .arm').getBBox(); return Math.hypot(b.width, b.height)"
    browser.settle()
    assert browser.run(width) > 0
    assert arrows(browser) != turned


def test_key_n_reads_out_the_worst_pose(laptop, fits):
    stage(laptop).send_keys("n")
    laptop.settle()
    words = laptop.driver.find_element(By.CSS_SELECTOR, ".readout").text
    lengths = np.linalg.norm(fits[-1].residuals(), axis=1)
    row = fits[-1].data.rows[int(np.argmax(lengths))]
    assert words.startswith(f"Row {row}: {1e6 * lengths.max():.0f} µm")


def test_first_step_is_shown_at_the_same_scale(laptop):
    def ruler() -> str:
        return str(laptop.run("return document.querySelector('.ruler').getAttribute('d')"))

    before, scale = arrows(laptop), ruler()
    first = laptop.driver.find_element(By.CSS_SELECTOR, "input[name=vectors-step][value='0']")
    laptop.run("arguments[0].click()", first)
    assert arrows(laptop) != before
    assert ruler() == scale


def test_arrow_key_chooses_the_next_state_view(laptop):
    shown = """return [...document.querySelectorAll('.view')]
        .filter((view) => view.checkVisibility()).map((view) => view.dataset.view)"""
    assert laptop.run(shown) == ["telling"]
    chosen = laptop.driver.find_element(By.CSS_SELECTOR, "input[name=state-view]:checked")
    chosen.send_keys(Keys.ARROW_RIGHT)
    assert laptop.run(shown) == ["x"]


def test_tab_key_reaches_all_controls_in_order(laptop):
    laptop.run("document.body.focus(); window.scrollTo(0, 0)")
    reached = []
    for _ in range(80):
        ActionChains(laptop.driver).send_keys(Keys.TAB).perform()
        reached.append(
            laptop.run(
                "const e = document.activeElement; return e.className || e.getAttribute('href') || e.name || e.tagName"
            )
        )
    assert reached[0] == "skip"
    assert reached[1:4] == ["#error", "#vectors", "#state"]
    for stop in ("vectors-step", "stage", "state-view", "scroll", "SUMMARY"):
        assert stop in reached


def test_accessibility_tree_has_headings_and_names(laptop):
    nodes = laptop.command("Accessibility.getFullAXTree")["nodes"]
    read = [
        (node["role"]["value"], node.get("name", {}).get("value", ""))
        for node in nodes
        if not node.get("ignored") and "role" in node
    ]
    headings = [name for role, name in read if role == "heading"]
    assert headings[0] == "kr30"
    assert {"How the error fell", "Where the error points", "What is missing"} <= set(headings)
    pictures = [name for role, name in read if role in ("image", "img")]
    assert len(pictures) > 25
    assert all(pictures)
    assert [name for role, name in read if role == "navigation"] == ["sections"]
    assert "main" in {role for role, _ in read}


def test_printed_report_has_all_sections(browser, page, tmp_path):
    browser.open(page)
    path = tmp_path / "report.pdf"
    path.write_bytes(browser.paper())
    text = subprocess.run(
        ["pdftotext", "-layout", path, "-"], capture_output=True, text=True, check=True
    ).stdout
    assert 4 < text.count("\f") <= 8
    for words in (
        "How the error fell",
        "Why, and how large",
        "gear_harmonics[3].sin1",
        "What could not be observed",
        "Rejected rows",
    ):
        assert words in text
    assert "Next worst" not in text


def test_report_of_eight_added_effects_prints_on_eight_sheets(browser, fits, tmp_path):
    longer, diagnoses = [fits[0]], [diagnose(fits[0])]
    while len(longer) < 9:
        tried = (c for c in diagnoses[-1].candidates if not _has(longer[-1], c))
        best = next(tried)
        longer.append(add(longer[-1], best["effect"], best["joints"] or None, best["options"]))
        diagnoses.append(diagnose(longer[-1]))
    write(longer, tmp_path / "report.html", names=[f"model {k}" for k in range(9)], known=diagnoses)
    browser.open(tmp_path / "report.html")
    (tmp_path / "report.pdf").write_bytes(browser.paper())
    told = subprocess.run(
        ["pdfinfo", tmp_path / "report.pdf"], capture_output=True, text=True, check=True
    ).stdout
    assert int(re.search(r"Pages:\s+(\d+)", told)[1]) <= 8
    text = subprocess.run(
        ["pdftotext", tmp_path / "report.pdf", "-"], capture_output=True, text=True, check=True
    ).stdout
    assert all(f"After step {k}:" in text for k in range(1, 10)), "every step's diagnosis stands there"


def _has(fit: Fit, candidate) -> bool:
    """True where the model has the effect on some of these joints."""
    return any(
        entry["effect"] == candidate["effect"] and set(entry.get("joints", [])) & set(candidate["joints"])
        for entry in fit.effects
    )


def test_printed_report_opens_every_folded_part(browser, page):
    browser.open(page, media="print")
    folded, hidden = browser.run("""
        const parts = [...document.querySelectorAll('details')].filter((d) => d.checkVisibility());
        const shut = parts.filter((d) => ![...d.children].some((c) => c.tagName !== 'SUMMARY'
            && c.checkVisibility({contentVisibilityAuto: true}) && c.getBoundingClientRect().height > 0));
        return [parts.length, shut.map((d) => d.querySelector('summary').textContent)]""")
    assert folded >= 3
    assert hidden == []


def test_printed_tables_fit_their_column(browser, page):
    browser.open(page, A4, media="print")
    wide = browser.run("""
        return [...document.querySelectorAll('.listings table')]
            .filter((t) => t.getBoundingClientRect().width > t.parentElement.getBoundingClientRect().width + 1)
            .map((t) => t.caption.textContent)""")
    assert wide == []


def test_printed_figures_do_not_break_across_sheets(browser, page):
    browser.open(page, A4, media="print")
    broken = browser.run(
        "return [...document.querySelectorAll('figure')].filter((figure) => figure.checkVisibility())"
        ".filter((f) => getComputedStyle(f).breakInside !== 'avoid' || f.offsetHeight > arguments[0])"
        ".map((figure) => figure.textContent.slice(0, 60))",
        A4[1],
    )
    assert broken == []


def test_printed_report_is_white_in_dark_mode_with_three_views(browser, page):
    browser.open(page, dark=True, media="print")
    assert (
        browser.run("return getComputedStyle(document.documentElement).backgroundColor")
        == "rgb(255, 255, 255)"
    )
    stills = "return [...document.querySelectorAll('.stills svg')].filter((s) => s.checkVisibility()).length"
    assert browser.run(stills) == 3
    assert browser.run("return document.querySelector('nav').checkVisibility()") is False


def test_without_scripts_only_one_picture_is_missing(browser, page):
    browser.open(page, scripts=False)
    tree = browser.command("Accessibility.getFullAXTree")["nodes"]
    names = [node.get("name", {}).get("value", "") for node in tree if not node.get("ignored")]
    assert any("needs JavaScript" in name for name in names)
    assert sum(name.startswith("Spectrum of the residual") for name in names) == 6


def test_candidate_bars_are_as_long_as_their_shares(laptop):
    bars = laptop.run("""
        const wide = (e, name) => e.querySelector(name).offsetWidth;
        const shares = [...document.querySelectorAll('.share')].filter((e) => e.checkVisibility());
        return shares.map((e) => [parseFloat(e.textContent), wide(e, '.bar') / wide(e, '.bar-track')])""")
    assert len(bars) >= 8
    for percent, length in bars:
        assert length == pytest.approx(percent / 100.0, abs=0.02)


def test_tap_on_an_arrow_reads_it_out(browser, page):
    browser.open(page, PHONE)
    stage(browser)
    x, y = browser.run("""const box = document.querySelector('.stage').getBoundingClientRect();
        const first = document.querySelector('.stage .start').getAttribute('d');
        const [, x, y] = first.match(/M([\\d.]+) ([\\d.]+)/);
        return [box.x + Number(x), box.y + Number(y)]""")
    for kind, points in (("touchStart", [{"x": x, "y": y}]), ("touchEnd", [])):
        browser.command("Input.dispatchTouchEvent", type=kind, touchPoints=points)
    browser.settle()
    assert browser.driver.find_element(By.CSS_SELECTOR, ".readout").text.startswith("Row ")


def test_lines_and_marks_differ_in_more_than_colour(laptop, fits: list[Fit]):
    """The first step's lines are dashed where the last step's are solid, and marks differ in shape."""
    dashes = laptop.run("""return ['first', 'last', 'threshold', 'ratio'].map((name) =>
        getComputedStyle(document.querySelector('#spectra .' + name)).strokeDasharray)""")
    assert len(set(dashes)) == 4
    assert (
        laptop.run(
            "return new Set([...document.querySelectorAll('.legend path')].map((p) => p.getAttribute('d'))).size"
        )
        == 4
    )
    widths = laptop.run("""return ['length0', 'length1', 'length2', 'length3'].map((name) =>
        parseFloat(getComputedStyle(document.querySelector('.stage .' + name)).strokeWidth))""")
    assert widths == sorted(set(widths))


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_lengths_of_arrows_differ_in_colour(browser, page, dark):
    browser.open(page, dark=dark)
    colours = browser.run("""return ['length0', 'length1', 'length2', 'length3'].map((name) =>
        getComputedStyle(document.querySelector('.stage .' + name)).stroke)""")
    assert len(set(colours)) == 4


def test_arrows_of_many_poses_are_thinner_and_shorter(browser, fits, tmp_path):
    drawn = scene(steps_of([(fits[0], "fit")]))
    many = {
        **drawn,
        "rows": 10 * drawn["rows"],
        "points": 10 * drawn["points"],
        "joints": 10 * drawn["joints"],
    }
    many["vectors"] = [10 * vectors for vectors in drawn["vectors"]]
    seen = []
    for k, each in enumerate((drawn, many)):
        place = tmp_path / f"{k}.html"
        place.write_text(document("arrows", viewer(each, "arrows")))
        browser.open(place)
        browser.settle()
        seen.append(
            browser.run("""
                const arrow = document.querySelector('.stage > svg > .length3');
                const scale = document.querySelector('.stage .ruler + text').textContent.split('×')[1];
                return [parseFloat(getComputedStyle(arrow).strokeWidth), Number(scale.replace(/\\D/g, ''))]""")
        )
    (width, scale), (many_width, many_scale) = seen
    assert many_width < 0.5 * width
    assert many_scale <= 0.5 * scale
