#include "fitter/start/prepared.h"

#include <algorithm>
#include <cstdio>

#include "fitter/model/kinematics.h"

namespace armtrue {
namespace {

// Moves measurements of separate set-ups into the frame of the first.
void move_rows(const State& state, const std::map<int, Pose>& set_ups, Measurements& measurements) {
  for (std::size_t i = 0; i < measurements.rows; ++i) {
    const Pose* pose = set_up_of(set_ups, state.columns(), i);
    if (!pose) continue;
    auto position = measurements.position.col(static_cast<Eigen::Index>(i));
    position = *pose * Eigen::Vector3d(position);
    Eigen::Matrix3d& whiten = measurements.whiten_position[i];
    whiten = whiten * pose->linear().transpose();
    if (!measurements.rotation.empty())
      measurements.rotation[i] = pose->linear() * measurements.rotation[i];
  }
}

void put_positions(const Measurements& measurements, State::Columns& columns) {
  const char* const axes[] = {"x", "y", "z"};
  for (int c = 0; c < 3; ++c) {
    const Eigen::RowVectorXd row = measurements.position.row(c);
    columns[axes[c]].assign(row.begin(), row.end());
  }
}

std::string apart_words(int number, const Pose& pose) {
  char text[200];
  std::snprintf(text, sizeof text,
                "station %d stands %.2f m and %.0f degrees from the first: the arm itself brought "
                "the two together; `station` in the model finds what is left of that",
                number, pose.translation().norm(),
                rotation_log(pose.linear()).norm() * 180.0 / 3.14159265358979);
  return text;
}

}  // namespace

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
  State::Columns together = columns;
  const auto state_with = [&](const Eigen::Vector3d& point) {
    auto state = std::make_unique<State>(prepared->robot, together, point);
    state->smooth_torques();
    if (state->recorded("time"))
      state->begin_time_at(*std::ranges::min_element(state->columns().at("time")));
    return state;
  };
  prepared->state = state_with(payload_point.value_or(Eigen::Vector3d::Zero()));
  prepared->measurements = Measurements::from_state(
      *prepared->state, accuracies.instrument, accuracies.assumed_sigma, accuracies.sigma_rotation);
  prepared->alignment = align(*prepared->state, prepared->measurements);
  const std::map<int, Pose>& set_ups = prepared->alignment.first_from_set_up;
  if (!set_ups.empty()) {
    move_rows(*prepared->state, set_ups, prepared->measurements);
    put_positions(prepared->measurements, together);
    for (const auto& [number, pose] : set_ups)
      prepared->warnings.push_back(apart_words(number, pose));
  }
  if (!payload_point || !set_ups.empty()) {
    // The payload hangs at the tool point, which is known only now.
    prepared->state = state_with(
        payload_point.value_or(prepared->alignment.flange_from_tool.front().translation()));
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
