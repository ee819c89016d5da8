// Virtual-joint coordinates: where a term acts. Names as in docs/model.md.
#pragma once

#include <string>

namespace armtrue {

enum class Place { kMotor, kBase, kLink, kTool };

inline constexpr const char* kComponentNames[6] = {"tx", "ty", "tz", "rx", "ry", "rz"};

/// One coordinate of the chain. `index` is the 0-based joint (motor, link) or target (tool);
/// `component` 0…5 = tx ty tz rx ry rz.
struct Coordinate {
  Place place = Place::kMotor;
  int index = 0;
  int component = 0;

  bool operator==(const Coordinate&) const = default;
};

/// Layout of all coordinates of an arm in one vector: motor 1…n, base, links 1…n, tools.
struct CoordinateLayout {
  int joints = 0;
  int targets = 1;

  int size() const { return joints + 6 + 6 * joints + 6 * targets; }
  int motor(int joint) const { return joint; }
  int base(int component) const { return joints + component; }
  int link(int joint, int component) const { return joints + 6 + 6 * joint + component; }
  int tool(int target, int component) const {
    return joints + 6 + 6 * joints + 6 * target + component;
  }
  int index(const Coordinate& c) const;
};

/// "motor3", "base.tz", "link2.rx", "tool.tx" (first target), "tool[1].tx" (target of that 0-based
/// index). Throws ModelError.
Coordinate parse_coordinate(const std::string& text, int joints, int targets);
std::string to_string(const Coordinate& coordinate, int targets);

}  // namespace armtrue
