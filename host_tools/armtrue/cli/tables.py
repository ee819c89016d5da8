"""The commands export, compensate, keygen and tables info."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from armtrue.cli.shared.fits import beyond_the_fit
from armtrue.cli.shared.options import FitArgument, JsonOption, OutOption, PosesArgument, TablesArgument
from armtrue.cli.shared.output import Output, plain_table
from armtrue.errors import InputError
from armtrue.io.files import csv_text, write_file
from armtrue.tables import ExportOptions, fitted_arm, layout, signing, validate
from armtrue.tables import export as make_image
from armtrue.tables.compensate import Engine, sidecar
from armtrue.tables.compensate import compensate as run
from armtrue.tables.image import Image, describe
from armtrue.tables.layout import Node, Section
from armtrue.units import plural

tables_app = typer.Typer(no_args_is_help=True, help="Inspect table images.")


def export(
    fit_file: FitArgument,
    out: OutOption,
    serial: Annotated[
        str | None,
        typer.Option(
            "--serial", help="Robot that the table is for; default: robot.yaml's serial, or its name."
        ),
    ] = None,
    tool: Annotated[
        str | None, typer.Option("--tool", metavar="TARGET", help="Tool to compensate; default: the first.")
    ] = None,
    pose: Annotated[
        bool, typer.Option("--pose", help="Hold the tool's attitude too, not only its position.")
    ] = False,
    sequence: Annotated[
        int,
        typer.Option(
            "--sequence",
            help=f"Number of this export, 0 to {layout.MAX_SEQUENCE}; a device takes only a table with a larger one "
            "than the table it has: give each further calibration a larger number, such as a date.",
        ),
    ] = 0,
    increments: Annotated[
        str | None,
        typer.Option(
            "--increments",
            metavar="N[,N…]",
            help="Drive increments per joint turn (metre), one number or one a joint, 16 to 2^31, with a minus where "
            "the drive counts down as the joint's angle grows (--increments=-1000000,2000000,…); "
            "default: 2^20 per motor turn where the gear ratio is known, else 2^24, without a minus.",
        ),
    ] = None,
    blend_ms: Annotated[
        int,
        typer.Option(
            "--blend-ms", min=20, max=65535, help="Blend time when a table is switched on, off or replaced."
        ),
    ] = 500,
    max_correction: Annotated[
        float | None,
        typer.Option(
            "--max-correction", help="Largest correction of a joint [rad, m]; default: from the model."
        ),
    ] = None,
    max_rate: Annotated[
        float, typer.Option("--max-rate", help="Largest rate of a correction [rad/s, m/s].")
    ] = 0.1,
    dead_band: Annotated[
        float,
        typer.Option("--dead-band", help="Motion that does not count as a change of direction [rad, m]."),
    ] = 2e-5,
    damping: Annotated[
        float | None,
        typer.Option("--damping", help="Damping near singularities [m/rad]; default: 0.4 % of the reach."),
    ] = None,
    payload_max: Annotated[
        float | None,
        typer.Option(
            "--payload-max",
            help="Largest payload [kg]; default: half the arm's mass, or 50, or the largest that was measured.",
        ),
    ] = None,
    sign: Annotated[
        Path | None, typer.Option("--sign", metavar="KEY", help="Sign with this key of 'armtrue keygen'.")
    ] = None,
    json_to: JsonOption = None,
) -> None:
    """Write the firmware's table image for a fit.

    Beside TABLES the fit is kept as TABLES.fit.json, for 'compensate --engine double'.

    Example: armtrue export fit.json --out tables.bin
    """
    from armtrue import fitting

    output = Output(json_to)
    for name, value, least, most in (
        ("--sequence", sequence, 0, layout.MAX_SEQUENCE),
        ("--max-correction", max_correction, 1e-6, 1.0),
        ("--max-rate", max_rate, 1e-4, 100.0),
        ("--dead-band", dead_band, 0.0, 0.1),
        ("--damping", damping, 1e-6, layout.DAMPING[1]),
        ("--payload-max", payload_max, 0.0, 1e5),
    ):
        _refuse_beyond(name, value, least, most)
    document = fitting.Fit.load(fit_file).document
    options = ExportOptions(
        serial=serial,
        tool=tool,
        full_pose=pose,
        sequence=sequence,
        increments=_numbers(increments),
        blend_ms=blend_ms,
        damping_m=damping,
        max_correction=max_correction,
        max_rate=max_rate,
        dead_band=dead_band,
        payload_max_kg=payload_max,
        secret_seed=None if sign is None else signing.read_key(sign, "secret"),
    )
    arm = fitted_arm(document, fit_file)
    result = make_image(arm, options, fit_file)
    # Checked by the firmware's own reader before anything is written.
    described = describe(Image(result.image, out))
    write_file(out, result.image)
    write_file(sidecar(out), json.dumps(document) + "\n")
    output.items(result.notes)
    output.say(
        f"written: {out} ({len(result.image)} bytes, "
        f"{'signed' if options.secret_seed else 'not signed'}), {sidecar(out)}"
    )
    behind = {effect: {"why": why, "effect_um": size} for effect, (why, size) in arm.stays_behind.items()}
    output.figures({**described, "notes": result.notes, "stays_behind": behind})


def compensate(
    tables: TablesArgument,
    poses: PosesArgument,
    out: OutOption,
    engine: Annotated[
        Engine,
        typer.Option(
            "--engine",
            help="fixed: the firmware's code; double: the inverse of the fit in double precision, with loads as a "
            "device takes them (for compliant arms some micrometres from the fit's own).",
        ),
    ] = Engine.FIXED,
    fit: Annotated[
        Path | None,
        typer.Option(
            "--fit",
            metavar="FIT",
            help="The fit that TABLES was exported from, for remaining errors; default: TABLES.fit.json.",
        ),
    ] = None,
    increments: Annotated[
        bool, typer.Option("--increments", help="Round corrections to the drives' increments.")
    ] = False,
    json_to: JsonOption = None,
) -> None:
    """Correct commands: q1…qn with which the real tool reaches the nominal point of the given ones.

    The result also has tx, ty, tz: the point that each command was meant for, in the measuring frame. Corrected joints
    beyond their limits are written nevertheless, with a warning. Rows with more than 20 µm and 5 % of their error
    remaining are counted, and the worst is named; --json has the remaining error of each row. `time` is read on the
    clock of the measurements that were fitted; without the fit beside TABLES, as seconds since the first of them.

    Example: armtrue compensate tables.bin poses.csv --engine fixed --out corrected.csv
    """
    output = Output(json_to)
    result = run(tables, poses, engine, fit, increments)
    columns = result.columns()
    rows = np.column_stack([*columns.values(), result.intended])
    cells = [[f"{value:.10f}" for value in row] for row in rows]
    write_file(out, csv_text([*columns, "tx", "ty", "tz"], cells))
    output.items(result.notes)
    output.say(f"written: {out} ({plural(len(result.joints), 'pose')})")
    if leaving := result.limits_words():
        why = "table and firmware do not contain joint limits, and these rows are written unchanged"
        print(f"armtrue: warning: {out}: {leaving}; {why}", file=sys.stderr)
    for note in beyond_the_fit(tables, fit, poses):
        print(f"armtrue: warning: {note}", file=sys.stderr)
    beyond = {str(k + 1): int(count) for k, count in enumerate(result.beyond.sum(axis=0)) if count}
    output.figures(
        {
            "poses": len(result.joints),
            "engine": engine.value,
            "notes": result.notes,
            "rows_beyond_limits_by_joint": beyond,
            "left": None if result.remainder is None else result.remainder.figures(),
        }
    )


def keygen(
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="KEY", help="Secret key to write; KEY.pub is written beside it."),
    ],
) -> None:
    """Make an Ed25519 key pair: sign tables with KEY, build KEY.pub into the devices that are to accept them.

    Example: armtrue keygen --out armtrue.key
    """
    public_path, key = signing.write_key_pair(out)
    output = Output(None)
    output.say(f"written: {out} (secret: keep it, and do not share it), {public_path}")
    output.say(f"public key: {key.hex()}")


@tables_app.command()
def info(
    tables: TablesArgument,
    terms: Annotated[
        bool, typer.Option("--terms", help="Print every state variable, node and term.")
    ] = False,
    key: Annotated[
        Path | None, typer.Option("--key", metavar="KEY.pub", help="Check the signature with this key.")
    ] = None,
    json_to: JsonOption = None,
) -> None:
    """Print what a table image holds, and what rounding its tables costs at the tool.

    Example: armtrue tables info tables.bin
    """
    output = Output(json_to)
    image = Image.load(tables)
    if key is not None:
        verdict = validate(image.bytes, public_key=signing.read_key(key, "public"))
        if not verdict.accepted:
            raise InputError(f"{tables}: found {verdict.reason}, expected a signature by the owner of {key}")
    document = describe(image)
    document["signature_checked"] = key is not None
    _present(document, image, output, terms)
    output.figures(document)


def _refuse_beyond(name: str, value: float | None, least: float, most: float) -> None:
    # Every comparison with NaN is false, so NaN is refused as well.
    if value is not None and not least <= value <= most:
        found = f"{value:.10g}" if isinstance(value, float) else value
        raise InputError(f"{name}: found {found}, expected {least:.10g} to {most:.10g}")


def _numbers(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.replace(",", " ").split())
    except ValueError:
        raise InputError(f"--increments: found '{text}', expected numbers such as 131072") from None


def _quoted(name: str) -> str:
    return repr(name) if name else "unnamed"


def _present(document: dict[str, Any], image: Image, output: Output, terms: bool) -> None:
    """Print `document`; with `terms` every record of the term list too."""
    checked = "right" if document["signature_checked"] else "not checked (--key)"
    signature = f"signed, signature {checked}" if document["signed"] else "not signed"
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
