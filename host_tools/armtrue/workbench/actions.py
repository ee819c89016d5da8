"""The actions of the page's buttons: each makes or shows a model of the session, or computes something for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from armtrue.candidates import model_entry
from armtrue.diagnosis import refine
from armtrue.errors import InputError
from armtrue.fitting import Fit, with_effects
from armtrue.io.model import check_effect
from armtrue.units import plural
from armtrue.workbench.first_figures import FirstFigures, fit_to_some
from armtrue.workbench.opening.dropped import LOOK_AT_GUESSES
from armtrue.workbench.outputs import make
from armtrue.workbench.session import Node, Session, joined_files
from armtrue.workbench.showing.beside import planned_between
from armtrue.workbench.showing.further import Result, rows_between
from armtrue.workbench.showing.left_out import error_there, said_there
from armtrue.workbench.showing.measured_again import compared, joined
from armtrue.workbench.showing.poses import planned
from armtrue.workbench.showing.words import change_words, fall_words, first_words, length, rows_words

if TYPE_CHECKING:
    from armtrue.workbench.engine import Engine

Entry = dict[str, Any]
_LONGEST_NAME = 80


class PausedError(Exception):
    """The user asked Refine to pause, and its current step has ended."""


def candidates_of(session: Session) -> list[Entry]:
    """Candidates of the shown model. Errors: InputError where its diagnosis is not finished yet."""
    diagnosis = session.diagnosis_of(session.at)
    if diagnosis is None:
        raise InputError("candidate: the diagnosis is still being worked out, expected it to end first")
    return list(diagnosis["candidates"])


def _add(engine: Engine, words: Entry) -> None:
    entry = _candidate(engine.session, words)
    fit = engine.session.fit_of(engine.session.at)
    checked = check_effect(entry, fit.robot, "add", fit.effects, fit.data.columns)
    _change(engine, [*fit.effects, checked])


def _remove(engine: Engine, words: Entry) -> None:
    effects = engine.session.node.effects
    place = _whole(words, "effect", len(effects))
    if len(effects) == 1:
        raise InputError(f"{effects[0]['effect']} is the only effect of the model, expected one to remain")
    _change(engine, [entry for k, entry in enumerate(effects) if k != place])


def _swap(engine: Engine, words: Entry) -> None:
    """Replace an effect of the model by a candidate."""
    fit = engine.session.fit_of(engine.session.at)
    place = _whole(words, "effect", len(fit.effects))
    rest = [entry for k, entry in enumerate(fit.effects) if k != place]
    checked = check_effect(_candidate(engine.session, words), fit.robot, "swap", rest, fit.data.columns)
    _change(engine, [*rest, checked])


def _candidate(session: Session, words: Entry) -> Entry:
    """The entry of model.yaml of a candidate, given by its index in the diagnosis or as an entry."""
    if "entry" in words:
        entry = words["entry"]
        if not isinstance(entry, dict):
            raise InputError(f"add: found {entry!r}, expected an effect with its joints")
        return entry
    candidates = candidates_of(session)
    return model_entry(candidates[_whole(words, "candidate", len(candidates))])


def _change(engine: Engine, effects: list[Entry]) -> None:
    """Show the model with these effects: one that was made from the shown model before, or a new one."""
    session = engine.session
    if child := _made_before(session, effects):
        session.go(child.number)
        engine.said = child.said
        return
    _put(engine, _fitted(engine, session.fit_of(session.at), effects))


def _made_before(session: Session, effects: list[Entry]) -> Node | None:
    """The model with these effects that was made from the shown one; None where there is none."""
    wanted = (effects, session.node.left_out)
    children = session.children(session.at)
    return next((child for child in children if (child.effects, child.left_out) == wanted), None)


def _fitted(engine: Engine, base: Fit, effects: list[Entry], left_out: list[int] | None = None) -> Fit:
    """Fit `base` with these effects; with many measurements the page shows first figures, from some, meanwhile."""
    some = fit_to_some(base, effects, engine.tell)
    if some is not None:
        node = node_of(engine.session, some, left_out)
        engine.show_first_figures(FirstFigures(node, some, base.data.count))
    return with_effects(base, effects, engine.tell)


def _leave_out(engine: Engine, words: Entry) -> None:
    rows = words.get("rows")
    if not isinstance(rows, list) or not all(isinstance(row, int) for row in rows):
        raise InputError(f"leave_out: found {rows!r}, expected a list of row numbers")
    session = engine.session
    known = set(session.data.rows.tolist())
    if unknown := sorted(set(rows) - known):
        raise InputError(f"leave_out: found row {unknown[0]}, expected a row of {session.data.file.name}")
    out = sorted(set(rows))
    bare = Fit(session.fit_of(session.at).document, None, session.data.without(out))
    _put(engine, _fitted(engine, bare, session.node.effects, out), out)


def _leave_out_where(engine: Engine, words: Entry) -> None:
    rows = rows_between(engine.session.fit_of(engine.session.at), words)
    _leave_out(engine, {"rows": [*engine.session.node.left_out, *rows]})


def _plan(engine: Engine, words: Entry) -> None:
    if "node" in words:
        other = _whole(words, "node", len(engine.session.nodes))
        _show(engine, planned_between(engine.session, other, words, engine.tell))
        return
    fit = engine.session.fit_of(engine.session.at)
    rivals = None
    if "rivals" in words:
        candidates = candidates_of(engine.session)
        if not isinstance(words["rivals"], list):
            raise InputError(f"rivals: found {words['rivals']!r}, expected a list of candidates")
        places = [_whole({"rivals": place}, "rivals", len(candidates)) for place in words["rivals"]]
        rivals = [model_entry(candidates[place]) for place in places]
    with fit.lock:
        _show(engine, planned(fit, words, rivals, engine.tell))


def _compare(engine: Engine, words: Entry) -> None:
    result = compared(engine.session.fit_of(engine.session.at), engine.drop, words)
    if result is None:
        engine.said = "Look at what was guessed of the file, then press Compare with the model."
    else:
        _show(engine, result)


def _join(engine: Engine, _words: Entry) -> None:
    opened = joined(engine.session.fit_of(engine.session.at), engine.drop, engine.tell)
    before = engine.session
    engine.begin(opened, linked=engine.linked)
    before.keep({"joined": list(dict.fromkeys([*joined_files(before), str(opened.files[0])]))})
    engine.drop.forget()
    engine.said = f"{opened.notes[0]}. {engine.session.node.said}"


def _switch(engine: Engine, words: Entry) -> None:
    engine.look_at(*engine.linked[_whole(words, "session", len(engine.linked))])
    engine.said = f"{engine.about}. {engine.session.node.said}"


def _show(engine: Engine, result: Result) -> None:
    engine.result, engine.said = result, result.said
    engine.made = result.made or engine.made


def _undo(engine: Engine, _words: Entry) -> None:
    node = engine.session.node
    if node.parent is None:
        raise InputError("there is nothing to undo")
    _look(engine, node.parent, f"Undone: {node.change}")


def _redo(engine: Engine, _words: Entry) -> None:
    forward = engine.session.node.redo
    if forward is None:
        raise InputError("there is nothing to redo")
    _look(engine, forward, f"Done again: {engine.session.nodes[forward].change}")


def _go(engine: Engine, words: Entry) -> None:
    _look(engine, _whole(words, "node", len(engine.session.nodes)), "Another model")


def _look(engine: Engine, number: int, what: str) -> None:
    before = engine.session.node.mean_um
    engine.session.go(number)
    engine.said = f"{what}. {fall_words(before, engine.session.node.mean_um)}"


def _name(engine: Engine, words: Entry) -> None:
    node = engine.session.nodes[_whole(words, "node", len(engine.session.nodes))]
    node.name = str(words.get("name", ""))[:_LONGEST_NAME]
    engine.session.save()
    engine.said = f"This model is now called {node.name}." if node.name else "This model has no name now."


def _diagnose(engine: Engine, _words: Entry) -> None:
    """Allow a stopped diagnosis; the engine starts it when this action has ended."""
    engine.background.allow()
    engine.said = f"The diagnosis is worked out. {engine.session.node.said}"


def _refine(engine: Engine, _words: Entry) -> None:
    session = engine.session
    first = session.node.mean_um
    steps = 0

    def keep(fit: Fit, step: Entry) -> None:
        nonlocal steps
        diagnosis = {key: value for key, value in step.items() if key not in ("added", "removed")}
        if fit.effects != session.node.effects:
            if child := _made_before(session, fit.effects):
                session.go(child.number)
            else:
                _put(engine, fit, diagnosis=diagnosis)
            engine.announce()
            steps += 1
        if session.diagnosis_of(session.at) is None:
            session.diagnosed(session.at, diagnosis)
        if engine.pausing.is_set():
            raise PausedError

    try:
        refine(session.fit_of(session.at), engine.tell, keep)
    except PausedError:
        what = f"Paused after {plural(steps, 'step')}; Refine goes on"
    else:
        what = f"Refined in {steps} steps" if steps != 1 else "Refined in one step"
        if not steps:
            engine.said = "Refine found nothing to add or remove."
            return
    engine.said = f"{what}. {fall_words(first, session.node.mean_um)}"


def _open(engine: Engine, words: Entry) -> None:
    opened = engine.drop.open(words)
    if opened is None:
        engine.said = LOOK_AT_GUESSES if "look" not in words else "The check and the picture follow the form."
        if "mend" in words:
            engine.said = "It is mended. Look at what the check says now, then open the files."
        return
    was_open = engine.is_open
    engine.begin(opened, progress=engine.tell)
    engine.drop.forget()
    if not was_open:
        engine.keep_waiting()


def _forget(engine: Engine, _words: Entry) -> None:
    engine.drop.forget()
    engine.said = "The files are put aside."


def _make(engine: Engine, words: Entry) -> None:
    engine.made = None
    engine.made = make(engine.session, str(words.get("name")), engine.tell)
    size = max(1, round(len(engine.made.content) / 1000))
    mean = length(engine.session.node.mean_um)
    engine.said = f"{engine.made.name} is made ({size} kB). The held-out mean error is {mean}."


def _upload(engine: Engine, _words: Entry) -> None:
    device = engine.own_device
    image = make(engine.session, "tables", engine.tell).content
    engine.said = device.upload(image, engine.tell)


def _confirm(engine: Engine, _words: Entry) -> None:
    engine.own_device.order("cfrm")
    engine.said = "The table on the device is confirmed: every later start takes it."


def _revert(engine: Engine, _words: Entry) -> None:
    engine.own_device.order("rvrt")
    engine.said = "The device has gone back to the table before."


def _put(engine: Engine, fit: Fit, left_out: list[int] | None = None, diagnosis: Entry | None = None) -> None:
    node = node_of(engine.session, fit, left_out, diagnosis)
    engine.session.put(node, fit, diagnosis)
    engine.first_figures = None
    engine.said = node.said


def node_of(
    session: Session, fit: Fit, left_out: list[int] | None = None, diagnosis: Entry | None = None
) -> Node:
    """The next node of `session`, a child of the shown node."""
    before = session.node if session.nodes else None
    effects = fit.effects
    old = before.effects if before else []
    added = [entry for entry in effects if entry not in old] if before else []
    removed = [entry for entry in old if entry not in effects]
    out = left_out if left_out is not None else before.left_out if before else []
    change = change_words(added, removed) or rows_words(out, before.left_out if before else None)
    floor = fit.document["noise_floor"]["um"]
    verdict = None if diagnosis is None else str(diagnosis["verdict"])
    node = Node(
        len(session.nodes), before.number if before else None, effects, added, removed, out,
        fit.document["error"], floor, verdict, change, "",
        left_out_error=error_there(fit, session.data, out), turn_error_rad=fit.orientation_error(),
    )  # fmt: skip
    said = [first_words(node.mean_um)]
    if before:
        said = [f"{change[0].upper()}{change[1:]}. {fall_words(before.mean_um, node.mean_um)}"]
    node.said = " ".join([*said, *_held_back(fit, added), *([said_there(node)] if out else [])])
    return node


def _held_back(fit: Fit, added: list[Entry]) -> list[str]:
    """Why an added effect changes nothing: the fit's sentences about effects with all parameters held at nominal."""
    parameters = fit.document["parameters"]
    names = {entry["effect"] for entry in added}
    names -= {parameter["effect"] for parameter in parameters if not parameter["held"]}
    sentences = fit.document["unobservable"]
    return [
        f"These data do not show it: {said}." for said in sentences if any(name in said for name in names)
    ]


def _whole(words: Entry, key: str, count: int) -> int:
    value = words.get(key)
    if not isinstance(value, int) or not 0 <= value < count:
        raise InputError(f"{key}: found {value!r}, expected a number from 0 to {count - 1}")
    return value


WORK: dict[str, Callable[[Engine, Entry], None]] = {
    "add": _add,
    "remove": _remove,
    "swap": _swap,
    "undo": _undo,
    "redo": _redo,
    "refine": _refine,
    "go": _go,
    "name": _name,
    "diagnose": _diagnose,
    "leave_out": _leave_out,
    "leave_out_where": _leave_out_where,
    "make": _make,
    "upload": _upload,
    "confirm": _confirm,
    "revert": _revert,
    "plan": _plan,
    "compare": _compare,
    "join": _join,
    "switch": _switch,
    "open": _open,
    "forget": _forget,
}
# Actions that do not stop a running diagnosis: they need neither the library's fit nor much processor time.
BESIDE_A_DIAGNOSIS = {"upload", "confirm", "revert", "name", "compare", "forget", "diagnose"}
