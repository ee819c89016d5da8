// libFuzzer: any bytes as the JSON that the core is handed: a robot, and terms of a fit. What is no
// robot must end in an exception; a robot must be able to move.
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "fitter/model/kinematics.h"
#include "fitter/model/term.h"

namespace {

using nlohmann::json;

// Arms that no memory holds are refused by the reader in front (host_tools/armtrue/io), not here.
constexpr std::size_t kMostJoints = 64;

void move(const json& content) {
  if (!content.contains("kinematics") ||
      content["kinematics"].value("joints", json::array()).size() > kMostJoints)
    return;
  const armtrue::Robot robot = armtrue::Robot::from_json(content);
  armtrue::Kinematics kinematics(robot, 1);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(kinematics.layout().size());
  const Eigen::VectorXd q = Eigen::VectorXd::Constant(robot.joint_count(), 0.3);
  Eigen::Matrix<double, 6, Eigen::Dynamic> jacobian;
  kinematics.forward(q.data(), zero.data(), 0, jacobian);
}

void read_terms(const json& content) {
  for (const json& term : content) {
    const armtrue::Term read = armtrue::term_from_json(term, 6, 1);
    static_cast<void>(armtrue::to_json(read, 1).dump());
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const json content = json::parse(data, data + size, nullptr, false);
  if (content.is_discarded()) return 0;
  try {
    if (content.is_array()) {
      read_terms(content);
    } else if (content.is_object()) {
      move(content);
    }
  } catch (const armtrue::ModelError&) {
  } catch (const armtrue::ExpressionError&) {
  } catch (const json::exception&) {
  }
  return 0;
}
