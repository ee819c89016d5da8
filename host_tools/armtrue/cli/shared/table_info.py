"""The content of a table image as text for the terminal."""

from __future__ import annotations

from typing import Any

import numpy as np

from armtrue.cli.shared.output import Output, plain_table
from armtrue.tables.image import Image
from armtrue.tables.layout import Node, Section
from armtrue.units import plural


def _quoted(name: str) -> str:
    return repr(name) if name else "unnamed"


def present(document: dict[str, Any], image: Image, output: Output, terms: bool) -> None:
    """Print `document`; with `terms` every record of the term list too."""
    signature = "signed" if document["signed"] else "not signed"
    if document["signed"]:
        signature += (
            ", signature right" if document["signature_checked"] else ", signature not checked (--key)"
        )
    output.say(
        f"table format {document['format_version']} for robot '{document['robot_serial']}', "
        f"sequence {document['sequence']}, {document['bytes']} bytes, {signature}"
    )
    output.say(
        f"fit {document['fit_sha256'][:16]}…, {'full pose' if document['full_pose'] else 'position only'}"
    )
    output.say(
        f"blend {document['blend_ms']} ms, damping {document['damping_m_per_rad']:.4f} m/rad, "
        f"tools {', '.join(_quoted(name) for name in document['tools'])} ({_quoted(document['active_tool'])} active)"
    )
    loads = document["loads_act_at"]
    place = f"; loads act at the {'corrected ' if loads == 'command' else ''}{loads}" if loads else ""
    output.say(f"reads besides the joints: {', '.join(document['needs']) or 'nothing'}{place}")
    table = plain_table(
        "joint", "increments per turn (m)", "one is [µm at tool]", "max [mrad, mm]", "max rate [mrad/s]"
    )
    for k, joint in enumerate(document["joints"]):
        if joint["passive"]:
            table.add_row(str(k + 1), "no drive", "–", "–", "–")
            continue
        turn = 1.0 if joint["type"] == "prismatic" else 2.0 * np.pi
        table.add_row(
            str(k + 1),
            f"{joint['increments_per_unit'] * turn:.10g}",
            f"{joint['increment_um_at_tool']:.3f}",
            f"{1e3 * joint['max_correction']:.3f}",
            f"{1e3 * joint['max_rate']:.1f}",
        )
    output.table(table)
    counts = document["counts"]
    output.say(
        f"{plural(counts['state_variables'], 'state variable')}, "
        f"{plural(counts['nodes'], 'node')} ({counts['nodes_once_a_cycle']} once a "
        f"cycle), {plural(counts['terms'], 'term')} ({counts['terms_once_a_cycle']} once a cycle), "
        f"{plural(counts['harmonics'], 'harmonic')}, "
        f"{plural(counts['slow_waves'], 'slow wave')}, "
        f"{plural(counts['mass_sets'], 'mass set')}"
    )
    output.say(
        f"a control cycle takes at most {document['cycle_instructions']} instructions of "
        f"{document['cycle_instructions_budget']} (STM32F405)"
    )
    output.say("bytes: " + ", ".join(f"{name} {size}" for name, size in document["section_bytes"].items()))
    if document["tables"]:
        grids = plain_table(
            "table on", "over", "nodes", "covered", "largest [µrad, µm]", "rounding [µm at tool]"
        )
        for entry in document["tables"]:
            axes = entry["axes"]
            grids.add_row(
                entry["coordinate"],
                ", ".join(axis["variable"] for axis in axes),
                " × ".join(str(axis["nodes"]) for axis in axes),
                f"{100 * entry['covered']:.0f} %",
                f"{1e6 * entry['largest']:.1f}",
                f"{entry['quantisation_um']:.3f}",
            )
        output.table(grids)
    if terms:
        _present_records(image, output)


def _present_records(image: Image, output: Output) -> None:
    states = image.count(Section.STATE)
    output.title("State variables")
    for slot in range(states):
        output.say(f"  slot {slot:3}: {image.state_name(slot)}")
    output.title("Nodes")
    for number, (kind, shift, shift2, count, a, b, p, r) in enumerate(image.nodes()):
        if kind is Node.CONTINUATION:
            words = "continued"
        else:
            words = f"{kind.name.lower()} a={a} b={b} shift={shift} shift2={shift2} count={count} p={p} r={r}"
        output.say(f"  slot {states + number:3}: {words}")
    output.title("Terms")
    for coordinate, slot, factor in image.terms():
        output.say(f"  {coordinate} += {factor:.9g} × slot {slot}")
    output.title("Harmonics")
    for coordinate, variable, order, phase, amplitude in image.harmonics():
        output.say(f"  {coordinate} += {amplitude:.6g} sin({order:.10g} {variable} + {phase:.6f})")
    output.title("Slow waves")
    for coordinate, variable, (sine, cosine, sine2, cosine2) in image.slow_waves():
        output.say(
            f"  {coordinate} += {sine:.6g} sin {variable} + {cosine:.6g} cos {variable} "
            f"+ {sine2:.6g} sin 2{variable} + {cosine2:.6g} cos 2{variable}"
        )
