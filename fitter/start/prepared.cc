#include "fitter/start/prepared.h"

#include <algorithm>

namespace armtrue {

std::shared_ptr<const Prepared> prepare(const Robot& robot, const State::Columns& columns,
                                        const Accuracies& accuracies) {
  if (columns.empty() || columns.begin()->second.empty())
    throw ModelError("measurements: found no row, expected at least 4 poses");
  auto prepared = std::make_shared<Prepared>();
  prepared->robot = robot;
  std::optional<Eigen::Vector3d> payload_point = robot.payload_point;
  const bool has_tool_point = robot.flange_from_tool.has_value();
  if (!payload_point) {
    if (const std::optional<Pose> tool =
            has_tool_point ? robot.flange_from_tool : robot.nominal_tool(0)) {
      payload_point = tool->translation();
    }
  }
  const auto state_with = [&](const Eigen::Vector3d& point) {
    auto state = std::make_unique<State>(prepared->robot, columns, point);
    state->smooth_torques();
    if (state->recorded("time"))
      state->begin_time_at(*std::ranges::min_element(state->columns().at("time")));
    return state;
  };
  prepared->state = state_with(payload_point.value_or(Eigen::Vector3d::Zero()));
  prepared->measurements = Measurements::from_state(
      *prepared->state, accuracies.instrument, accuracies.assumed_sigma, accuracies.sigma_rotation);
  prepared->alignment = align(*prepared->state, prepared->measurements);
  if (!payload_point) {
    // The payload hangs at the tool point, which is known only now.
    prepared->state = state_with(prepared->alignment.flange_from_tool.front().translation());
  }
  if (prepared->state->has("payload") && prepared->measurements.targets > 1 &&
      !robot.payload_point && !has_tool_point) {
    prepared->warnings.push_back(
        "the payload is taken to hang at the first reflector: robot.yaml names neither a tool nor "
        "the payload's centre of mass (payload: {com: [x, y, z]})");
  }
  return prepared;
}

}  // namespace armtrue
