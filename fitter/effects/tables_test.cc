#include "fitter/effects/tables.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "fitter/solve/choose_options.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::ProblemOptions;
using testing::Random;

double at(const std::string& expression, double q1) {
  const std::vector<double> column{q1};
  return Expression::parse(expression)
      .evaluate(1, [&](const std::string&) -> const std::vector<double>& { return column; })
      .front();
}

TEST(Hats, AddUpToOneInsideAndFadeOverTheOutermostCell) {
  const std::vector<double> nodes{0.0, 1.0, 2.0, 4.0};
  const auto sum = [&](double q1) {
    double total = 0.0;
    for (std::size_t i = 0; i < nodes.size(); ++i) total += at(hat_expression("q1", nodes, i), q1);
    return total;
  };
  for (const double q1 : {0.0, 0.3, 1.0, 2.5, 4.0}) EXPECT_DOUBLE_EQ(sum(q1), 1.0);
  EXPECT_DOUBLE_EQ(sum(-0.25), 0.75);
  EXPECT_DOUBLE_EQ(sum(5.0), 0.5);
  EXPECT_EQ(sum(-1.0), 0.0);
  EXPECT_EQ(sum(6.0), 0.0);
}

TEST(Hats, SingleNode_IsConstant) { EXPECT_EQ(at(hat_expression("q1", {0.3}, 0), -7.0), 1.0); }

const json kGrid{{"effects", {"base_frame", "tool_offset", "residual_grid"}}};

// Nodes on each axis of the fitted grid.
std::vector<int> nodes_of(const Model& model) {
  for (const Parameter& p : model.parameters) {
    if (p.effect != "residual_grid") continue;
    std::vector<int> counts;
    for (const auto& axis : p.terms.front().table->axes) {
      counts.push_back(static_cast<int>(axis.nodes.size()));
    }
    return counts;
  }
  return {};
}

// An arm whose only error is a shift of `size_m` times sin(waves q2) of link 1.
Problem wavy_arm(double waves, double size_m, Random& random) {
  const std::string wave = "sin(" + std::to_string(waves) + "*q2)";
  const json truth{{"effects",
                    {"base_frame",
                     "tool_offset",
                     {{"effect", "custom"},
                      {"name", "wave"},
                      {"coordinate", "link1.tx"},
                      {"expression", wave},
                      {"unit", "m"}}}}};
  ProblemOptions options;
  options.rows = 300;
  options.noise_m = 1e-5;
  return Problem(testing::industrial_arm(), truth, options, random,
                 [&](const Parameter& p) { return p.effect == "custom" ? size_m : 0.0; });
}

ModelSpecification closed(const Problem& problem) {
  FitOptions options;
  options.cross_validate = false;
  return close_options(*problem.state, ModelSpecification::from_json(kGrid), options);
}

TEST(ResidualGrid, AddsNodesOnlyOnJointsWhereTheErrorBends) {
  Random random(5);
  const auto chosen = [&](double size_m) {
    const ModelSpecification found = closed(wavy_arm(3.0, size_m, random));
    return found.effects.back().options["nodes"].get<std::vector<int>>();
  };
  EXPECT_EQ(chosen(0.0), (std::vector<int>{3, 3, 3}));
  const std::vector<int> bent = chosen(1e-4);
  EXPECT_GE(bent[1], 5);
  EXPECT_LE(bent[0], 4);
  EXPECT_LE(bent[2], 4);
}

TEST(ResidualGrid, KeepsTheNodesThatAUserGives) {
  Random random(6);
  const Problem problem = wavy_arm(3.0, 1e-4, random);
  json model = kGrid;
  model["effects"][2] = {{"effect", "residual_grid"}, {"nodes", {4, 5, 3}}};
  FitOptions options;
  options.cross_validate = false;
  const auto fit =
      Fit::run(problem.robot, problem.columns, ModelSpecification::from_json(model), options);
  EXPECT_EQ(nodes_of(fit->model()), (std::vector<int>{4, 5, 3}));
}

TEST(ResidualGrid, LeavesOutNodesThatNoMeasurementReaches) {
  Random random(7);
  Problem problem = wavy_arm(3.0, 1e-4, random);
  // Nothing is measured in a quarter of the range of joints 1 and 2.
  State::Columns kept;
  for (std::size_t i = 0; i < problem.columns["q1"].size(); ++i) {
    if (problem.columns["q1"][i] >= 0.0 && problem.columns["q2"][i] >= 0.0) continue;
    for (const auto& [name, values] : problem.columns) kept[name].push_back(values[i]);
  }
  json model = kGrid;
  model["effects"][2] = {{"effect", "residual_grid"}, {"nodes", {8, 8, 3}}};
  FitOptions options;
  options.cross_validate = false;
  const auto fit = Fit::run(problem.robot, kept, ModelSpecification::from_json(model), options);
  const auto present = [&](const std::string& node) {
    return fit->model().index("residual_grid.node" + node + "_tx") >= 0;
  };
  EXPECT_TRUE(present("1_1_1"));
  EXPECT_FALSE(present("8_8_2"));
}

}  // namespace
}  // namespace armtrue
