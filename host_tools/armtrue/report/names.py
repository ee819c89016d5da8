"""What effects, candidates and steps are called on the page."""

from __future__ import annotations

from typing import Any

from armtrue.candidates import entry_of, name


def called(candidate: dict[str, Any]) -> str:
    """A candidate's effect and joints, and the options that tell it from others of the same."""
    options = candidate.get("options") or {}
    words = [
        f"{key} {_plain(value)}" for key, value in options.items() if key not in ("cycles", "wavelengths")
    ]
    return ", ".join([name(candidate), *words])


def bracketed(label: str) -> str:
    """`gear_harmonics 3`, as diagnose names others, the way the page writes it."""
    return called(entry_of(label))


def gathered(effects: list[tuple[str, tuple[int, ...]]]) -> list[str]:
    """Effects with joints as people write them, those of one effect on single joints in one."""
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
