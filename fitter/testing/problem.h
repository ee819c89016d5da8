// A robot with measurements and a model, as in a fit, for tests of the parts of the solver.
#pragma once

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "fitter/design/design.h"
#include "fitter/design/model.h"
#include "fitter/testing/arms.h"

namespace armtrue::testing {

/// Options of a Problem; the defaults suit most tests.
struct ProblemOptions {
  std::size_t rows = 60;
  bool with_rotation = false;
  int targets = 1;
  double noise_m = 0.0;
  double noise_rad = 0.0;
  std::optional<Instrument> instrument{};
};

/// Nominal arm, recorded state, and measured poses of an arm whose parameters have the values given
/// by `truth`.
class Problem {
 public:
  /// `truth(parameter)` gives the true value of each linear parameter of the model.
  template <typename Truth>
  Problem(const nlohmann::json& robot_json, const nlohmann::json& model_json,
          const ProblemOptions& options, Random& random, const Truth& truth)
      : robot(Robot::from_json(robot_json)) {
    columns = random_joints(robot, options.rows, random);
    add_recorded_state(robot, random, columns);
    if (options.targets > 1) {
      for (std::size_t i = 0; i < options.rows; ++i) {
        columns["target"].push_back(
            static_cast<double>(i % static_cast<std::size_t>(options.targets)));
      }
    }
    kinematics = std::make_unique<Kinematics>(robot, options.targets);
    kinematics->set_base(random_base(random));
    for (int t = 0; t < options.targets; ++t) kinematics->set_tool(t, random_tool(random));
    set_measured(std::vector<Pose>(options.rows, Pose::Identity()), options.with_rotation, columns);
    build(model_json, options);
    for (Parameter& p : model.parameters) p.value = truth(p);
    std::vector<Pose> poses = predict_poses(*state, measurements.target, model, *kinematics);
    for (Pose& pose : poses) {
      pose.translation() += normal3(random, options.noise_m);
      pose.linear() = rotation_exp(normal3(random, options.noise_rad)) * pose.linear();
    }
    true_values.clear();
    for (Parameter& p : model.parameters) true_values.push_back(std::exchange(p.value, 0.0));
    set_measured(poses, options.with_rotation, columns);
    build(model_json, options);
  }

  Design make_design() const { return Design(*state, measurements, model, *kinematics); }

  Robot robot;
  State::Columns columns;
  std::unique_ptr<State> state;
  Measurements measurements;
  Model model;
  std::unique_ptr<Kinematics> kinematics;
  std::vector<double> true_values;

 private:
  void build(const nlohmann::json& model_json, const ProblemOptions& options) {
    state = std::make_unique<State>(robot, columns, kinematics->tool(0).translation());
    const double sigma = options.noise_m > 0.0 ? options.noise_m : 1e-5;
    const double sigma_rotation = options.noise_rad > 0.0 ? options.noise_rad : 2e-5;
    measurements = Measurements::from_state(*state, options.instrument, sigma, sigma_rotation);
    measurements.targets = options.targets;
    EffectContext context{
        *state, options.targets,
        std::vector<bool>(static_cast<std::size_t>(options.targets), options.with_rotation)};
    context.carried = {{"tau2", Expression::parse("1e-3*sin(q2 - 0.2)")}};
    model = build_model(ModelSpecification::from_json(model_json), context);
  }
};

/// True values of an arm without errors.
inline double nothing(const Parameter&) { return 0.0; }

/// A third of the coefficient's bound, or of the weak prior on geometry.
inline double typical_size(const Parameter& p) { return p.bound > 0.0 ? 0.3 * p.bound : 1e-3; }

}  // namespace armtrue::testing
