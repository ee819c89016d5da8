"""Names of effects, candidates and steps on the page."""

from __future__ import annotations

from typing import Any

from armtrue.candidates import entry_of, name


def called(candidate: dict[str, Any]) -> str:
    """A candidate's effect and joints, and the options that distinguish it from others of the same effect."""
    options = candidate.get("options") or {}
    words = [
        f"{key} {_plain(value)}" for key, value in options.items() if key not in ("cycles", "wavelengths")
    ]
    return ", ".join([name(candidate), *words])


def bracketed(label: str) -> str:
    """The page's name of a candidate that diagnose names as `gear_harmonics 3`."""
    return called(entry_of(label))


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


def _plain(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_plain, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
