"""Systematic errors of the instrument: its scale, its circles, its set-ups, a reflector put back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .mechanics.transforms import Array, Pose

# sin and cos of azimuth, added to the azimuth; sin and cos of elevation, added to the elevation
CIRCLES = ("azimuth_sin", "azimuth_cos", "elevation_sin", "elevation_cos")


@dataclass(frozen=True)
class TrackerError:
    """Systematic errors. scale: relative, of distances. circles: rad by harmonic (from 1) and the names in CIRCLES.

    stations: by number, pose of that set-up's measuring frame in the first one's; nests: by number, displacement
    (metres, in the tool's frame) of a reflector that was put back.
    """

    scale: float = 0.0
    circles: Mapping[tuple[int, str], float] = field(default_factory=dict)
    stations: Mapping[int, Pose] = field(default_factory=dict)
    nests: Mapping[int, Array] = field(default_factory=dict)

    def __add__(self, other: TrackerError) -> TrackerError:
        return TrackerError(
            self.scale + other.scale,
            {
                key: self.circles.get(key, 0.0) + other.circles.get(key, 0.0)
                for key in {*self.circles, *other.circles}
            },
            {**self.stations, **other.stations},
            {**self.nests, **other.nests},
        )

    def scaled(self, factor: float) -> TrackerError:
        """All of it `factor` times as large."""
        return TrackerError(
            factor * self.scale,
            {key: factor * value for key, value in self.circles.items()},
            {key: Pose.from_vector(factor * pose_vector(pose)) for key, pose in self.stations.items()},
            {key: factor * value for key, value in self.nests.items()},
        )

    def as_seen(self, points: Array, rotation: Array, columns: Mapping[str, Array], origin: Array) -> Array:
        """Points (N, 3) as the tracker at `origin` measures them; `rotation` (N, 3, 3) is the tool's."""
        seen = points.copy()
        if not (self.scale or self.circles or self.stations or self.nests):
            return seen
        for number, shift in self.nests.items():
            rows = columns["nest"] == number
            seen[rows] += rotation[rows] @ shift
        sight = seen - origin
        across = np.hypot(sight[:, 0], sight[:, 1])
        distance = np.linalg.norm(sight, axis=1) * (1.0 + self.scale)
        azimuth, elevation = np.arctan2(sight[:, 1], sight[:, 0]), np.arctan2(sight[:, 2], across)
        turned, raised = azimuth.copy(), elevation.copy()
        for (harmonic, name), value in self.circles.items():
            circle, _, wave = name.partition("_")
            angle = azimuth if circle == "azimuth" else elevation
            error = value * (np.sin if wave == "sin" else np.cos)(harmonic * angle)
            if circle == "azimuth":
                turned += error
            else:
                raised += error
        flat = distance * np.cos(raised)
        seen = origin + np.stack(
            [flat * np.cos(turned), flat * np.sin(turned), distance * np.sin(raised)], axis=1
        )
        for number, pose in self.stations.items():
            rows = columns["station"] == number
            seen[rows] = (seen[rows] - pose.translation) @ pose.rotation
        return seen

    def turned(self, rotation: Array, columns: Mapping[str, Array]) -> Array:
        """Rotations (N, 3, 3) of the tool, each in the measuring frame of its row's set-up."""
        result = rotation.copy()
        for number, pose in self.stations.items():
            rows = columns["station"] == number
            result[rows] = pose.rotation.T @ rotation[rows]
        return result

    def as_dict(self) -> dict[str, object]:
        """For truth.json."""
        return {
            "scale": self.scale,
            "circles": {f"{name}_{harmonic}": v for (harmonic, name), v in self.circles.items()},
            "stations": {str(number): pose.xyz_rpy() for number, pose in self.stations.items()},
            "nests": {str(number): [float(v) for v in shift] for number, shift in self.nests.items()},
        }


def pose_vector(pose: Pose) -> Array:
    """Translation and rotation vector of a pose that turns by far less than half a turn."""
    r = pose.rotation
    twist = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2.0
    sine = float(np.linalg.norm(twist))
    return np.concatenate([pose.translation, twist * (np.arcsin(sine) / sine if sine > 0.0 else 1.0)])
