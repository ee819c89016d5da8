"""A scenario: one YAML file that defines an arm, its errors, and how it is measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from .errors import ScenarioError
from .instrument import Instrument

BELIEVED = ("base_frame", "tool_offset", "joint_offset", "link_geometry", "joint_compliance")
COLUMNS_TO_ADD = ("sigma", "tau", "qr", "orientation", "travel", "duty")

# Folders of the shipped scenarios: in a wheel inside the package, in a checkout beside it.
_SHIPPED = (Path(__file__).with_name("scenarios"), Path(__file__).parents[1] / "scenarios")


def _shipped(path: Path) -> Path:
    """The path of a shipped scenario that is named without folder and ending; any other path unchanged."""
    named = [folder / f"{path}.yaml" for folder in _SHIPPED if path.name == str(path)]
    return next((file for file in named if file.exists() and not path.is_file()), path)


@dataclass
class Scenario:
    """All settings of a data set; each field is a key of the YAML file, in SI units.

    arm: a preset's name (kr30, irb2400, cobot, lbr, scara, stanford, rail, palletiser); convention: mdh or dh;
      variant: a number, for an arm of that kind with lengths, masses and gears of its own.
    believed: effects that model.yaml lists; hidden: effects that it lacks; unlike: further errors of robot.yaml
      (mass_parameters, gravity_direction), in no list. Each an effect id or a mapping
      {effect, joints, sizes that are not drawn, scale: factor on all sizes}. The real arm has all of them.
    poses: rows per reflector, `repeats: {poses, times}` at the end among them; test_poses; interval: seconds a pose.
    instrument: see Instrument.from_dict; repeatability: {drive: rad} or {tool_mean: m}, and
      {joints: {number: rad}} for joints with another repeatability.
    payloads: kg, payload_order: random or blocks; directions: random, order (from the sequence of poses) or up.
    temperature: {ambient, rise, time_constant, jitter, wave: K that sensors after the first swing by on their own};
    sensors: names, if not the preset's. columns: {omit: [...], add: [sigma, tau, qr, orientation, travel, duty]}.
    rests: {count, seconds, cold}: pauses in which nothing moves; if cold is true, the sensors then start as at the
      beginning; setups: {stations, nests}: number of each, in blocks.
    targets: reflectors {names, order: each_pose or cycle}; gross_errors: {count, size: [m, m], bump: {row, shift: m}}.
    readback: {lag: rad, noise: rad}; torque_noise: Nm; robot_file: {omit: [links, tool, base]}.
    base, tool: {xyz, rpy} of the real arm, drawn if absent; nominal_error: {base: m, tool: m} of robot.yaml's.
    floor: m, lowest flange in the base frame; joint_range: [[low, high], ...] inside the limits, where the instrument
    sees the tool; statics: deflected (loads at the deflected pose) or nominal.
    """

    arm: str
    name: str = ""
    seed: int = 0
    convention: str = "mdh"
    variant: int | None = None
    believed: list[Any] = field(default_factory=lambda: list(BELIEVED))
    hidden: list[Any] = field(default_factory=list)
    unlike: list[Any] = field(default_factory=list)
    poses: int = 240
    repeats: dict[str, int] = field(default_factory=lambda: {"poses": 4, "times": 3})
    test_poses: int = 60
    interval: float = 25.0
    instrument: dict[str, Any] = field(default_factory=lambda: {"sigma": 8e-6})
    repeatability: dict[str, Any] = field(default_factory=lambda: {"drive": 2.5e-6})
    payloads: list[float] | None = None
    payload_order: str = "random"
    directions: str = "random"
    temperature: dict[str, float] = field(default_factory=dict)
    columns: dict[str, list[str]] = field(default_factory=dict)
    sensors: list[str] = field(default_factory=list)
    rests: dict[str, float] = field(default_factory=dict)
    setups: dict[str, int] = field(default_factory=dict)
    targets: dict[str, Any] = field(default_factory=dict)
    gross_errors: dict[str, Any] = field(default_factory=dict)
    readback: dict[str, float] = field(default_factory=lambda: {"lag": 2e-4, "noise": 2e-6})
    torque_noise: float = 0.5
    robot_file: dict[str, list[str]] = field(default_factory=dict)
    base: dict[str, list[float]] | None = None
    tool: dict[str, list[float]] | None = None
    nominal_error: dict[str, float] = field(default_factory=lambda: {"base": 5e-3, "tool": 1e-3})
    floor: float | None = None
    joint_range: list[list[float]] | None = None
    statics: str = "deflected"
    where: str = "scenario"

    def __post_init__(self) -> None:
        self._choice("convention", ("mdh", "dh"))
        self._choice("payload_order", ("random", "blocks"))
        self._choice("directions", ("random", "order", "up"))
        self._choice("statics", ("nominal", "deflected"))
        for key, least in (("poses", 1), ("test_poses", 0), ("seed", 0), ("variant", 0)):
            value = getattr(self, key)
            if key == "variant" and value is None:
                continue
            if not isinstance(value, int) or isinstance(value, bool) or value < least:
                raise ScenarioError(
                    f"{self.where}: '{key}' is {value!r}, expected a whole number of at least {least}"
                )
        self._keys("repeats", {"poses", "times"})
        self._keys("repeatability", {"drive", "tool_mean", "joints"})
        self._keys("rests", {"count", "seconds", "cold"})
        self._keys("setups", {"stations", "nests"})
        self._keys("temperature", {"ambient", "rise", "time_constant", "jitter", "wave"})
        self._keys("columns", {"omit", "add"})
        self._keys("targets", {"names", "order"})
        self._keys("gross_errors", {"count", "size", "bump"})
        self._keys("readback", {"lag", "noise"})
        self._keys("robot_file", {"omit"})
        self._keys("nominal_error", {"base", "tool"})
        for key in ("base", "tool"):
            if getattr(self, key) is not None:
                self._keys(key, {"xyz", "rpy"})
                if "xyz" not in getattr(self, key):
                    raise ScenarioError(f"{self.where}: '{key}' has no xyz, expected {{xyz: [3], rpy: [3]}}")
        for column in self.columns.get("add", []):
            if column not in COLUMNS_TO_ADD:
                raise ScenarioError(
                    f"{self.where}: columns.add holds '{column}', expected {', '.join(COLUMNS_TO_ADD)}"
                )
        repeated = self.repeats.get("poses", 0) * self.repeats.get("times", 0)
        if repeated and self.poses - repeated < self.repeats["poses"]:
            raise ScenarioError(f"{self.where}: {repeated} repeats do not fit into {self.poses} poses")
        if self.payloads is not None and not self.payloads:
            raise ScenarioError(f"{self.where}: 'payloads' is empty, expected at least one mass in kg")
        Instrument.from_dict(self.instrument, f"{self.where}: instrument")
        self.entries()

    @classmethod
    def from_dict(cls, given: Mapping[str, Any], where: str = "scenario") -> Scenario:
        """From the content of a scenario file. Raises ScenarioError naming the key that is wrong."""
        if not isinstance(given, Mapping):
            raise ScenarioError(
                f"{where}: holds {type(given).__name__}, expected a mapping with at least the key 'arm'"
            )
        known = {f.name for f in fields(cls)} - {"where"}
        unknown = sorted(str(key) for key in set(given) - known)
        if unknown:
            raise ScenarioError(f"{where}: unknown key '{unknown[0]}', expected {', '.join(sorted(known))}")
        if "arm" not in given:
            raise ScenarioError(f"{where}: no key 'arm'")
        return cls(**given, where=where)

    @classmethod
    def from_file(cls, path: str | Path) -> Scenario:
        """From a YAML file, or the name of one that is shipped; a scenario without a name gets the file's.

        Raises ScenarioError.
        """
        path = _shipped(Path(path))
        try:
            content = yaml.safe_load(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise ScenarioError(f"{path}: cannot be read ({error.strerror})") from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ScenarioError(f"{path}: is not YAML ({' '.join(str(error).split())})") from error
        scenario = cls.from_dict(content, str(path))
        scenario.name = scenario.name or path.stem
        return scenario

    def entries(self) -> list[tuple[str, str, list[int] | None, dict[str, Any]]]:
        """Every entry: believed, hidden or unlike; effect; joints or None; given sizes. Raises ScenarioError."""
        found: list[tuple[str, str, list[int] | None, dict[str, Any]]] = []
        for role in ("believed", "hidden", "unlike"):
            for i, entry in enumerate(getattr(self, role)):
                if isinstance(entry, str):
                    found.append((role, entry, None, {}))
                elif isinstance(entry, Mapping) and "effect" in entry:
                    sizes = {key: value for key, value in entry.items() if key not in ("effect", "joints")}
                    joints = entry.get("joints")
                    if joints is not None and not isinstance(joints, list):
                        raise ScenarioError(
                            f"{self.where}: {role}[{i}].joints is {joints!r}, expected a list"
                        )
                    found.append((role, str(entry["effect"]), joints, sizes))
                else:
                    raise ScenarioError(
                        f"{self.where}: {role}[{i}] is {entry!r}, expected an effect id or a mapping with 'effect'"
                    )
        return found

    def _choice(self, key: str, allowed: tuple[str, ...]) -> None:
        if getattr(self, key) not in allowed:
            raise ScenarioError(
                f"{self.where}: '{key}' is {getattr(self, key)!r}, expected {' or '.join(allowed)}"
            )

    def _keys(self, key: str, allowed: set[str]) -> None:
        value = getattr(self, key)
        if not isinstance(value, Mapping):
            raise ScenarioError(f"{self.where}: '{key}' is {value!r}, expected a mapping")
        unknown = sorted(str(k) for k in set(value) - allowed)
        if unknown:
            raise ScenarioError(
                f"{self.where}: '{key}' has '{unknown[0]}', expected {', '.join(sorted(allowed))}"
            )
