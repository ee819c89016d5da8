#include "fitter/design/placement.h"

#include <array>
#include <map>
#include <utility>

namespace armtrue {
namespace {

// Stated values of a pose's position, or of its orientation.
using Triple = std::array<const ParameterOverride*, 3>;

bool any(const Triple& t) { return t[0] || t[1] || t[2]; }

bool is_one_statement(const Triple& t) {
  if (!t[0] || !t[1] || !t[2]) return false;
  return t[0]->fixed == t[1]->fixed && t[1]->fixed == t[2]->fixed && t[0]->sigma == t[1]->sigma &&
         t[1]->sigma == t[2]->sigma;
}

// Coordinates act along the axes of the frame itself: if these are not parallel to the outer
// frame's, one of three stated values cannot be held alone.
void expect_whole(const Triple& stated, bool is_turned, const std::string& effect,
                  const std::string& names) {
  if (!any(stated) || !is_turned || is_one_statement(stated)) return;
  throw ModelError("model: parameters states a part of " + effect +
                   ", whose frame is turned; expected " + names +
                   " together, all fixed or all with one sigma");
}

Pose moved(const Pose& reference, const Triple& position, const Triple& angles,
           const std::string& effect) {
  Pose result = reference;
  if (any(angles)) {
    expect_whole(angles, true, effect, "rx, ry and rz");
    result.linear() = pose_from_xyz_rpy(Eigen::Vector3d::Zero(),
                                        {angles[0]->value, angles[1]->value, angles[2]->value})
                          .linear();
  }
  expect_whole(position, !result.linear().isIdentity(1e-9), effect, "tx, ty and tz");
  for (std::size_t c = 0; c < 3; ++c) {
    if (position[c]) result.translation()[static_cast<Eigen::Index>(c)] = position[c]->value;
  }
  return result;
}

}  // namespace

void place_as_stated(const ModelSpecification& specification, const Model& model,
                     Kinematics& kinematics) {
  struct Stated {
    Triple position{}, angles{};
    std::string effect;
  };
  std::map<std::pair<Place, int>, Stated> stated;
  for (const Parameter& p : model.parameters) {
    const auto found = specification.overrides.find(p.name);
    if (found == specification.overrides.end() || find_effect(p.effect).role() != Role::kPlacement)
      continue;
    const Coordinate& at = p.terms.front().coordinate;
    Stated& pose = stated[{at.place, at.index}];
    pose.effect = p.effect;
    const auto component = static_cast<std::size_t>(at.component);
    (component < 3 ? pose.position : pose.angles)[component % 3] = &found->second;
  }
  for (const auto& [where, pose] : stated) {
    const auto [place, target] = where;
    if (place == Place::kBase) {
      kinematics.set_base(moved(kinematics.base(), pose.position, pose.angles, pose.effect));
    } else {
      kinematics.set_tool(target,
                          moved(kinematics.tool(target), pose.position, pose.angles, pose.effect));
    }
  }
}

}  // namespace armtrue
