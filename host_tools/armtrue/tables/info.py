"""What a table image holds, as figures."""

from __future__ import annotations

from typing import Any

import numpy as np

from armtrue.tables import layout
from armtrue.tables.fixed import cycle_budget, cycle_cost
from armtrue.tables.image import Image
from armtrue.tables.layout import Section


def lever_m(image: Image, coordinate: str) -> float:
    """Largest displacement of the tool per unit of a coordinate: 1 for lengths, the arm beyond it for angles [m]."""
    number = layout.coordinate_number(coordinate)
    joints = image.joints()
    lengths = [float(np.linalg.norm(joint.fixed[:3, 3])) for joint in joints]
    tool = max(float(np.linalg.norm(tool[:3, 3])) for tool in image.tools().values())
    if number < layout.MAX_JOINTS:
        return 1.0 if joints[number].prismatic else sum(lengths[number + 1 :]) + tool
    frame, component = divmod(number - layout.MAX_JOINTS, 6)
    if component < 3:
        return 1.0
    return tool if frame == layout.TOOL_FRAME else sum(lengths[frame:]) + tool


def describe(image: Image) -> dict[str, Any]:
    """Everything that `armtrue tables info` prints."""
    header = image.header
    nodes = image.nodes()
    tools = list(image.tools())
    return {
        "format_version": header["version"],
        "bytes": len(image.bytes),
        "cycle_instructions": cycle_cost(image.bytes),
        "cycle_instructions_budget": cycle_budget(),
        "robot_serial": image.serial,
        "sequence": header["sequence"],
        "fit_sha256": header["fit_digest"].hex(),
        "signed": image.is_signed,
        "full_pose": image.is_full_pose,
        "blend_ms": header["blend_ms"],
        "damping_m_per_rad": image.damping_m,
        "rotation_length_m": image.rotation_length_m,
        "tools": tools,
        "active_tool": tools[header["active_tool"]],
        "sensors_reference_degc": image.sensors(),
        "needs": sorted(image.needs()),
        "loads_act_at": image.loads_act_at(),
        "joints": [
            {
                "type": "prismatic" if joint.prismatic else "revolute",
                "passive": joint.passive,
                "increments_per_unit": joint.increments,
                "increment_um_at_tool": 1e6 * lever_m(image, f"motor{k + 1}") / abs(joint.increments),
                "max_correction": joint.magnitude,
                "max_rate": joint.rate,
                "dead_band_increments": joint.dead_band_increments,
            }
            for k, joint in enumerate(image.joints())
        ],
        "counts": {
            "state_variables": image.count(Section.STATE),
            "nodes": len(nodes),
            "nodes_once_a_cycle": header["constant_nodes"],
            "terms": image.count(Section.TERMS),
            "terms_once_a_cycle": header["constant_terms"],
            "harmonics": image.count(Section.HARMONICS),
            "slow_waves": image.count(Section.SLOW_WAVES),
            "mass_sets": image.count(Section.MASS_SETS),
        },
        "section_bytes": {kind.name.lower(): size for kind, size in image.section_bytes().items()},
        "tables": _tables(image),
    }


def _tables(image: Image) -> list[dict[str, Any]]:
    """Tables and grids: axes, nodes, coverage, and half a unit of the last place in µm at the tool."""
    first_slot = image.count(Section.STATE)
    terms = image.terms()
    result = []
    for grid in image.grids():
        for output in range(grid.values.shape[-1]):
            slot = first_slot + grid.node + output
            for coordinate, _, factor in (term for term in terms if term[1] == slot):
                # A slot carries GRID_VALUE_FRACTION bits below the stored integer.
                unit = abs(factor) * 2.0**layout.GRID_VALUE_FRACTION
                result.append(
                    {
                        "coordinate": coordinate,
                        "axes": [
                            {
                                "variable": image.state_name(slot_of_axis),
                                "nodes": int(nodes.size),
                                "from": float(nodes[0]),
                                "to": float(nodes[-1]),
                            }
                            for slot_of_axis, nodes in grid.axes
                        ],
                        "covered": float(grid.covered.mean()),
                        "largest": float(np.abs(grid.values[..., output]).max() * unit),
                        "quantisation_um": 0.5e6 * unit * lever_m(image, coordinate),
                    }
                )
    return result
