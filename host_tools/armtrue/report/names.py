"""Names of effects, candidates and steps on the page."""

from __future__ import annotations

from armtrue.candidates import entry_of, name

# Candidates and effects are spelled as everywhere else.
called = name


def bracketed(label: str) -> str:
    """The name of a candidate that diagnose lists as `gear_mesh 3 orders [13]`."""
    return name(entry_of(label))


def gathered(effects: list[tuple[str, tuple[int, ...]]]) -> list[str]:
    """Names of effects with their joints; those of one effect on single joints are merged into one."""
    single: dict[str, list[int]] = {}
    for effect, joints in effects:
        if len(joints) == 1:
            single.setdefault(effect, []).append(joints[0])
    names = []
    for effect, joints in effects:
        whole = sorted(single[effect]) if len(joints) == 1 else list(joints)
        names.append(name({"effect": effect, "joints": whole}))
    return list(dict.fromkeys(names))
