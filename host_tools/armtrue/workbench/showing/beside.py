"""Two models side by side, and the candidates that could replace an effect of the model."""

from __future__ import annotations

from typing import Any

from armtrue import comparing
from armtrue.candidates import label as called
from armtrue.candidates import model_entry
from armtrue.candidates import name as named
from armtrue.errors import InputError
from armtrue.fitting import Fit, with_effects
from armtrue.progress import Progress
from armtrue.report.gathered.state import joint_unit
from armtrue.report.markup import Content, Markup, tag
from armtrue.report.parts import micrometres, minus, table
from armtrue.units import plural
from armtrue.verdicts import chance
from armtrue.workbench.session import Node, Session
from armtrue.workbench.showing.elements import button, card, number_of
from armtrue.workbench.showing.further import Result
from armtrue.workbench.showing.poses import planned
from armtrue.workbench.showing.words import length

_SHOWN_POSES = 10
_MOST_RIVALS = 12


def beside(session: Session, place: str) -> str:
    """The shown model beside the one at `place` of the history. Errors: InputError where there is none."""
    nodes = [session.node, session.nodes[number_of(place, len(session.nodes), "node")]]
    names = [f"{letter}: {_name(session, node)}" for letter, node in zip("AB", nodes, strict=True)]
    return card(
        "Two models side by side",
        _figures(session, nodes, names),
        tag("h3", "Where they differ most"),
        _poses(session, nodes),
        _deciding(nodes),
    )


def bayesian_information(session: Session, number: int) -> float:
    """BIC of a model up to a constant of its measurements."""
    return float(
        session.worked_out(number, "bic", lambda: comparing.bayesian_information(session.fit_of(number)))
    )


def _name(session: Session, node: Node) -> str:
    """The user's name for a model, or all changes on the path to it: two paths may end with the same change."""
    steps = session.path_to(node.number)
    return node.name or "; ".join(step.change for step in steps[1:]) or steps[0].change


def _figures(session: Session, nodes: list[Node], names: list[str]) -> Markup:
    fitted = [session.fit_of(node.number).document["parameters"] for node in nodes]
    counts = [sum(not parameter["held"] for parameter in parameters) for parameters in fitted]
    own = ["; ".join(map(named, effects)) or "none" for effects in _own_effects(nodes)]
    rows: list[list[Content]] = [
        ["effects that the other lacks", *own],
        ["held-out mean error", *(length(node.mean_um) for node in nodes)],
        ["parameters", *map(str, counts)],
    ]
    if nodes[0].left_out == nodes[1].left_out:
        bic = [bayesian_information(session, node.number) for node in nodes]
        share = comparing.probability_of_first(*bic)
        rows.append(["probability, one of the two being right", chance(share), chance(1.0 - share)])
        after = tag("p", f"BIC of B less that of A: {minus(f'{bic[1] - bic[0]:.0f}')}.")
    else:
        after = tag("p", "They were fitted to different rows: there is no probability to tell.")
    return tag("div", table(["", *names], rows, "Two models", words=(0, 1, 2)), after)


def _poses(session: Session, nodes: list[Node]) -> Markup:
    """The measured poses whose predictions are farthest apart."""
    fits = [session.fit_of(node.number) for node in nodes]
    found = comparing.difference(*fits)
    if not len(found.rows):
        return tag("p", "They were fitted to different rows, none of which both have.")
    rows: list[list[Content]] = []
    for k in range(min(_SHOWN_POSES, len(found.rows))):
        lengths = [micrometres(float(each[k])) for each in (found.apart_um, *found.errors_um)]
        rows.append([str(int(found.rows[k])), *lengths, _joints(fits[0], int(found.first[k]))])
    words = (
        f"Their predictions are {micrometres(float(found.apart_um.mean()))} µm apart on average, and "
        f"{micrometres(float(found.apart_um.max()))} µm at most."
    )
    ring = button("Ring these poses on the arm", "ring", rows=found.rows[:_SHOWN_POSES].tolist())
    heads = ["row", "apart [µm]", "error of A [µm]", "error of B [µm]", "joints"]
    return tag("div", tag("p", words), table(heads, rows, "Poses where they differ most", words=(0, 4)), ring)


def _joints(fit: Fit, place: int) -> str:
    units = [joint_unit(joint) for joint in fit.robot.joints]
    figures = zip(fit.data.joints[place], units, strict=True)
    return minus(" ".join(f"{value / size:.0f}{unit}" for value, (unit, size) in figures))


def _deciding(nodes: list[Node]) -> Content:
    if _rivals(nodes) is None:
        return None
    words = "Poses that tell the two apart best are planned and drawn under What next. "
    plan = button("Plan poses that decide", "plan", node=nodes[1].number)
    return [tag("h3", "Which poses would decide?"), tag("p", words, plan)]


def _own_effects(nodes: list[Node]) -> list[list[dict[str, Any]]]:
    """For each of two models, the effects that the other lacks."""
    return [
        [effect for effect in node.effects if effect not in other.effects]
        for node, other in zip(nodes, nodes[::-1], strict=True)
    ]


def _rivals(nodes: list[Node]) -> list[dict[str, Any]] | None:
    """The effects that two models differ by, one each; None where they differ otherwise."""
    own = _own_effects(nodes)
    return [own[0][0], own[1][0]] if [len(each) for each in own] == [1, 1] else None


def planned_between(session: Session, other: int, words: dict[str, Any], progress: Progress) -> Result:
    """Poses that decide between the shown model and another that differs from it by one effect."""
    nodes = [session.node, session.nodes[other]]
    rivals = _rivals(nodes)
    if rivals is None:
        raise InputError("plan: found models that differ by more than one effect each, expected one each")
    common = [effect for effect in nodes[0].effects if effect in nodes[1].effects]
    base = with_effects(session.fit_of(session.at), common, progress)
    return planned(base, words, rivals, progress)


def swaps(session: Session, place: str) -> str:
    """Candidates that could replace an effect of the shown model."""
    effects = session.node.effects
    number = number_of(place, len(effects), "effect")
    old = effects[number]
    candidates = _replacements(session, old)
    alike = {label for each in candidates if model_entry(each) == old for label in each["confounded_with"]}
    others = [each for each in candidates if model_entry(each) not in effects]
    others.sort(key=lambda each: (called(each) not in alike, -each["probability"]))
    rows = []
    for each in others[:_MOST_RIVALS]:
        spoken = f"Put {named(each)} in the place of {named(old)}"
        put = button("Put in its place", "swap", effect=number, entry=model_entry(each), aria_label=spoken)
        rows.append(
            tag("li", tag("span", f"{named(each)}: probability {chance(each['probability'])}"), " ", put)
        )
    first = "those that these data hardly tell from it come first, then " if alike else ""
    words = f"{plural(len(rows), 'effect')} could stand there; {first}the most probable first."
    return card(f"In the place of {named(old)}", tag("p", words), tag("ul", rows, class_="model"))


def _replacements(session: Session, old: dict[str, Any]) -> list[dict[str, Any]]:
    """Candidates of the shown model without `old`, if it was diagnosed.

    Else those of the model to which `old` was added, and those of the shown model that are not among them: effects
    removed since.
    """
    shown = session.node
    # In whatever order.
    rest = sorted(str(effect) for effect in shown.effects if effect != old)
    like_it = [node for node in session.nodes if node.left_out == shown.left_out]
    numbers = [node.number for node in like_it if sorted(map(str, node.effects)) == rest][:1]
    if not numbers:
        parents = (node.parent for node in session.path if old in node.added)
        numbers = [*(number for number in parents if number is not None), shown.number]
    found: dict[str, dict[str, Any]] = {}
    for diagnosis in filter(None, map(session.diagnosis_of, numbers)):
        for candidate in diagnosis["candidates"]:
            found.setdefault(str(model_entry(candidate)), candidate)
    return list(found.values())
