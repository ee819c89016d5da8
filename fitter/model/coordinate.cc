#include "fitter/model/coordinate.h"

#include <algorithm>
#include <regex>

#include "fitter/model/robot.h"

namespace armtrue {

int CoordinateLayout::index(const Coordinate& c) const {
  switch (c.place) {
    case Place::kMotor:
      return motor(c.index);
    case Place::kBase:
      return base(c.component);
    case Place::kLink:
      return link(c.index, c.component);
    case Place::kTool:
      return tool(c.index, c.component);
  }
  return 0;
}

Coordinate parse_coordinate(const std::string& text, int joints, int targets) {
  static const std::regex pattern(
      R"((motor([0-9]{1,2}))|((base|link([0-9]{1,2})|tool(\[([0-9]{1,4})\])?)\.([tr][xyz])))");
  std::smatch match;
  if (!std::regex_match(text, match, pattern)) {
    throw ModelError("coordinate '" + text +
                     "' is unknown, expected motorK, base.C, linkK.C or tool.C with C one of " +
                     "tx ty tz rx ry rz");
  }
  Coordinate result;
  const auto joint_number = [&](const std::string& digits) {
    const int number = std::stoi(digits);
    if (number < 1 || number > joints) {
      throw ModelError("coordinate '" + text + "' names joint " + digits + ", expected 1 to " +
                       std::to_string(joints));
    }
    return number - 1;
  };
  if (match[1].matched) {
    result.place = Place::kMotor;
    result.index = joint_number(match[2]);
    return result;
  }
  result.component =
      static_cast<int>(std::ranges::find(kComponentNames, match[8].str()) - kComponentNames);
  const std::string place = match[4];
  if (place == "base") {
    result.place = Place::kBase;
  } else if (match[5].matched) {
    result.place = Place::kLink;
    result.index = joint_number(match[5]);
  } else {
    result.place = Place::kTool;
    result.index = match[7].matched ? std::stoi(match[7]) : 0;
    if (result.index >= targets) {
      throw ModelError("coordinate '" + text + "' names target " + std::to_string(result.index) +
                       ", the data have " + std::to_string(targets));
    }
  }
  return result;
}

std::string to_string(const Coordinate& c, int targets) {
  const std::string component = kComponentNames[c.component];
  switch (c.place) {
    case Place::kMotor:
      return "motor" + std::to_string(c.index + 1);
    case Place::kBase:
      return "base." + component;
    case Place::kLink:
      return "link" + std::to_string(c.index + 1) + "." + component;
    case Place::kTool:
      return (targets > 1 ? "tool[" + std::to_string(c.index) + "]." : "tool.") + component;
  }
  return {};
}

}  // namespace armtrue
