"""Tables of fits, diagnoses and checks for a notebook, as HTML or text in place of Python's default repr."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from armtrue.candidates import name
from armtrue.units import value_and_sigma
from armtrue.verdicts import (
    ERROR_FIGURES,
    FLOOR_SOURCES,
    PARTS_OF_ERROR,
    chance,
    error_words,
    length_words,
    verdict_words,
    why_words,
)

_MOST_ROWS = 60


def html_table(headers: Sequence[str], rows: Iterable[Sequence[str]], caption: str) -> str:
    """A table of escaped texts."""
    head = "".join(f"<th>{escape(header)}</th>" for header in headers)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def error_rows(document: Mapping[str, Any]) -> list[list[str]]:
    """Name and figures [µm] of each part of a fit's error."""
    error = document["error"]
    return [[words, *error_words(error[part])] for part, words in PARTS_OF_ERROR.items() if error.get(part)]


def floor_sentence(document: Mapping[str, Any]) -> str:
    """The noise floor of a fit and its source."""
    floor = document.get("noise_floor") or {}
    if floor.get("um") is None:
        return "noise floor: not known, as the data hold no repeats and no sigma"
    source = floor.get("source", "none")
    return f"noise floor: {floor['um']:.1f} µm ({FLOOR_SOURCES.get(source, source)})"


def fit_text(document: Mapping[str, Any]) -> str:
    """A fit as a table of text: errors, noise floor, effects."""
    width = max(len(words) for words in PARTS_OF_ERROR.values())
    lines = [f"{'error [µm]':{width}}" + "".join(f"{word:>10}" for word in ERROR_FIGURES.values())]
    lines += [
        f"{row[0]:{width}}" + "".join(f"{cell:>10}" for cell in row[1:]) for row in error_rows(document)
    ]
    effects = ", ".join(name(entry) for entry in document["model"]["effects"])
    return "\n".join([*lines, floor_sentence(document), f"effects: {effects}"])


def fit_html(document: Mapping[str, Any]) -> str:
    """A fit as a notebook shows it: errors, noise floor, effects, and parameters with their standard deviations."""
    errors = html_table(["error [µm]", *ERROR_FIGURES.values()], error_rows(document), "Error of the fit")
    rows = []
    told = [entry for entry in document["parameters"] if not entry.get("held")]
    for entry in told[:_MOST_ROWS]:
        value, sigma, unit = value_and_sigma(entry["value"], entry.get("sigma"), entry["unit"])
        rows.append([entry["name"], value, sigma, unit])
    more = len(told) - len(rows)
    caption = f"Parameters{f', the first {len(rows)} of {len(told)}' if more else ''}"
    effects = ", ".join(name(entry) for entry in document["model"]["effects"])
    return (
        errors
        + f"<p>{escape(floor_sentence(document))}<br>effects: {escape(effects)}</p>"
        + html_table(["parameter", "value", "± sigma", "unit"], rows, caption)
    )


def diagnosis_html(diagnosis: Mapping[str, Any]) -> str:
    """A diagnosis as a notebook shows it: the verdict and the candidates, most evidence first."""
    rows = [
        [
            name(candidate),
            chance(candidate["probability"]),
            f"{100 * candidate['explained']:.1f} %",
            length_words(candidate["held_out_mean_um_if_added"]),
            "recommended" if candidate["recommend"] else why_words(candidate),
        ]
        for candidate in diagnosis["candidates"][:10]
    ]
    headers = ["candidate", "probability", "explains", "held-out mean if added [µm]", ""]
    return f"<p>{escape(verdict_words(dict(diagnosis)))}</p>" + html_table(headers, rows, "Candidates")
