#include <gtest/gtest.h>

#include <map>

#include "fitter/solve/fit.h"
#include "fitter/testing/arms.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

TEST(AxisStraightness, BesideArmGeometry_RecoversTheRailsErrors) {
  // Once, only priors separated mean and slope from the geometry of the joints on the rail: a turn
  // of 60 urad was reported as 107 urad, a shift of 40 um with a sigma of 160 um.
  Random random(3);
  const json robot = testing::random_chain(random, 7, {0});
  json model = testing::geometry_model();
  model["effects"].push_back({{"effect", "axis_straightness"}, {"joints", {1}}});
  const std::map<std::string, double> rail{
      {"axis_straightness[1].tx_2", 4e-5}, {"axis_straightness[1].tx_4", -3e-5},
      {"axis_straightness[1].ty_3", 5e-5}, {"axis_straightness[1].rx_3", -7e-5},
      {"axis_straightness[1].ry_2", 8e-5}, {"axis_straightness[1].rz_4", -6e-5}};
  const Problem p(robot, model, {250, false, 1, 1e-5, 2e-5, {}}, random, [&](const Parameter& q) {
    const auto there = rail.find(q.name);
    return there == rail.end() ? 0.0 : there->second;
  });
  const auto fit = Fit::run(p.robot, p.columns, ModelSpecification::from_json(model), {});
  const json document = fit->document();
  int compared = 0;
  for (const json& q : document["parameters"]) {
    const auto name = q["name"].get<std::string>();
    if (q["effect"] != "axis_straightness") continue;
    ++compared;
    const auto there = rail.find(name);
    const double truth = there == rail.end() ? 0.0 : there->second;
    ASSERT_TRUE(q["sigma"].is_number()) << name;
    EXPECT_LT(q["sigma"].get<double>(), 2e-5) << name;
    EXPECT_NEAR(q["value"].get<double>(), truth, 5.0 * q["sigma"].get<double>()) << name;
  }
  EXPECT_EQ(compared, 2 * 4 + 3 * 5);
}

}  // namespace
}  // namespace armtrue
