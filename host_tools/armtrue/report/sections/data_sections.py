"""The measurements: which were rejected, where the arm was, and what the report was made from."""

from __future__ import annotations

import datetime
import hashlib

import numpy as np

from armtrue import __version__
from armtrue.report.content import Report
from armtrue.report.gathered.state import joint_unit
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import ARCSECOND, figure, grid, lead, micrometres, minus, section, table
from armtrue.report.pictures import charts
from armtrue.tables.chain import pose
from armtrue.units import plural

_MOST_ROWS = 60
_COVERAGE = (
    "A model is worth as much as the poses it was fitted to. Joints that hardly moved, loads and temperatures that "
    "never changed, leave their effects unseen."
)


def rejected_section(report: Report) -> Markup:
    """Rows that were kept out of the fit as gross errors."""
    fit = report.last.fit
    rejected = sorted(fit.document["rejected"], key=lambda entry: -float(entry["residual_um"]))
    unread: list[Content] = []
    if skipped := [[str(entry["row"]), entry["why"]] for entry in fit.document["data"].get("skipped", [])]:
        caption = f"{plural(len(skipped), 'row')} left out because unreadable"
        unread.append(table(["row", "why"], skipped, caption, words=(1,)))
    if left_out := fit.data.left_out:
        rows_of_person = (
            f"{plural(len(left_out), 'row')} left out by a person: {', '.join(map(str, left_out))}."
        )
        unread.append(tag("p", rows_of_person))
    if not rejected:
        none = tag("p", f"None: all {fit.data.count} measurements that were read took part.")
        return section("rejected", "Rejected rows", none, unread)
    units = [joint_unit(joint) for joint in fit.robot.joints]
    rows: list[list[Content]] = []
    for entry in rejected[:_MOST_ROWS]:
        joints = fit.data.joints[entry["index"]]
        angles = [f"{q / factor:.1f}{unit}" for q, (unit, factor) in zip(joints, units, strict=True)]
        rows.append([str(entry["row"]), micrometres(entry["residual_um"]), minus("  ".join(angles))])
    more = len(rejected) - len(rows)
    return section(
        "rejected",
        "Rejected rows",
        lead(
            f"{len(rejected)} of {fit.data.count} measurements are further from the model than noise can bring them, "
            "and were kept out of the fit. Rows count from the top of the file, the header included."
        ),
        table(["row", "error [µm]", "joints"], rows, f"Rejected rows of {fit.data.file.name}, worst first"),
        tag("p", f"and {more} more") if more > 0 else None,
        unread,
    )


def coverage_section(report: Report) -> Markup:
    """Where the measurements are: joints within their limits, loads, temperatures, directions, the reflector."""
    fit = report.last.fit
    panels: list[Content] = []
    for number, joint in enumerate(fit.robot.joints, start=1):
        if number in fit.robot.passive:
            continue
        unit, factor = joint_unit(joint)
        values = fit.data.columns[f"q{number}"] / factor
        limits, share = None, ""
        if joint.get("limits"):
            limits = (joint["limits"][0] / factor, joint["limits"][1] / factor)
            share = f", {100.0 * float(np.ptp(values)) / (limits[1] - limits[0]):.0f} % of its range"
        words = minus(f"{values.min():.0f} to {values.max():.0f} {unit}{share}")
        label, spoken = f"joint {number} [{unit}]", f"Joint {number} was measured from {words}"
        panels.append(figure(f"Joint {number}", charts.histogram_panel(values, limits, label, spoken), words))
    for variable in report.variables:
        if not (variable.name.startswith("temp_") or variable.name in ("payload", "time")):
            continue
        words = minus(f"{variable.values.min():.4g} to {variable.values.max():.4g} {variable.unit}")
        spoken = f"{variable.what}: {words}"
        panel = charts.histogram_panel(variable.values, None, variable.label, spoken)
        panels.append(figure(variable.what.capitalize(), panel, words))
    panels += _places(report)
    return section("coverage", "Where the arm was measured", lead(_COVERAGE), grid(panels), _approach(report))


def made_words(report: Report) -> Content:
    """When this was made, by which version, and from which file with its checksum."""
    now, checksum = datetime.datetime.now(datetime.UTC), _checksum(report)
    return [
        f"{now:%Y-%m-%d %H:%M UTC} · Armtrue {__version__} · {report.last.fit.data.file.name} · SHA-256 ",
        tag("code", f"{checksum[:16]}…", title=checksum),
    ]


def _checksum(report: Report) -> str:
    """SHA-256 of the file of measurements, as `sha256sum` prints it."""
    return hashlib.sha256(report.last.fit.data.file.read_bytes()).hexdigest()


def about_section(report: Report) -> Markup:
    """Files and settings that the report was made from."""
    document = report.last.fit.document
    data, noise = document["data"], document["noise"]
    stated = noise["stated_sigma_um"]
    stated_words = f", {micrometres(stated)} µm stated" if stated is not None else ""
    turn = noise["sigma_rotation_rad"]
    turn_words = f"; orientation {turn / ARCSECOND:.1f}″ about each axis" if turn is not None else ""
    rows_words = (
        f"{data['rows']}, {len(document['rejected'])} rejected, {len(data.get('skipped', []))} unreadable, "
        f"{_repeats(report)}"
    )
    glossary = tag("a", "glossary", href="#glossary")
    rows: list[list[Content]] = [
        ["Armtrue", __version__],
        ["robot", report.last.fit.robot.spec.get("name", "")],
        ["measurements", data["path"]],
        [f"SHA-256 of {report.last.fit.data.file.name}", tag("code", _checksum(report))],
        ["SHA-256 of what was read of it", tag("code", data["sha256"])],
        ["rows", rows_words],
        ["columns", ", ".join(data["columns"])],
        ["noise per axis", f"{micrometres(noise['sigma_um'])} µm observed{stated_words}{turn_words}"],
        ["cross-validation", f"{document['error']['folds']} folds, seed {document['error']['seed']}"],
        *([["solver", message]] if (message := document["solver"]["message"]) else []),
        ["words of this page", [glossary, "; ", tag("code", "armtrue explain TERM"), " for any other"]],
    ]
    for step in report.steps:
        if step.fit.path:
            rows.append([f"fit of {step.called}", str(step.fit.path.resolve())])
    if unsaved := [f"step {step.number}" for step in report.steps if not step.fit.path]:
        rows.append(["fits that were not saved", ", ".join(unsaved)])
    settings = table(["what", "which"], rows, "Files and settings", words=(0, 1))
    return section("about", "What this was made from", settings)


def _places(report: Report) -> list[Content]:
    fit = report.last.fit
    measuring_from_base = pose(fit.document["measuring_from_base"])
    in_base = (fit.data.positions_m - measuring_from_base[:3, 3]) @ measuring_from_base[:3, :3]
    x, y, z = in_base.T
    above = charts.place_panel(x, y, ("x", "y"), "Places of the reflector seen from above, in the base")
    names = ("distance from axis 1", "z")
    side = charts.place_panel(np.hypot(x, y), z, names, "Reach and height of the reflector, in the base")
    return [figure("From above, in the base", above), figure("Reach and height, in the base", side)]


def _repeats(report: Report) -> str:
    repeat = report.last.fit.data.columns.get("repeat")
    if repeat is None:
        return "repeats not recorded"
    again = int(np.sum(np.unique(repeat, return_counts=True)[1] > 1))
    return f"{plural(again, 'pose')} measured more than once" if again else "no pose measured twice"


def _approach(report: Report) -> Markup | None:
    columns = report.last.fit.data.columns
    names = sorted((name for name in columns if name.startswith("dir")), key=lambda name: int(name[3:]))
    if not names:
        return None
    rows = [
        [f"joint {name[3:]}", *(str(int(np.sum(np.sign(columns[name]) == sign))) for sign in (-1, 0, 1))]
        for name in names
    ]
    headers = ["approached", "from above (−1)", "not moved (0)", "from below (+1)"]
    return table(headers, rows, "Direction of approach, number of poses")
