// Pairs of effects that move the measured points alike: the diagnosis must name both.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "fitter/diagnose/diagnose.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

// If axes 1 and 2 meet, a soft bearing of joint 2, equally soft about x and y, tilts the arm
// exactly as a soft bearing of joint 1 would.
TEST(LookAlikes, TwoEquivalentSoftBearings_AreReportedAsConfounded) {
  json robot = testing::industrial_arm();
  robot["kinematics"]["joints"][1]["a"] = 0.0;
  Random random(31);
  testing::add_links(random, robot);
  json model = testing::geometry_model();
  model["effects"].push_back({{"effect", "joint_compliance"}, {"joints", {2, 3}}});
  json truth = model;
  truth["effects"].push_back({{"effect", "bending_compliance"}, {"joints", {2}}});
  const Problem p(robot, truth, {240, false, 1, 1e-5, 2e-5, {}}, random, [&](const Parameter& q) {
    return q.effect == "bending_compliance" ? 3e-6 : q.effect == "joint_compliance" ? 2e-6 : 0.0;
  });
  const auto fit = Fit::run(p.robot, p.columns, ModelSpecification::from_json(model), {});
  const Diagnosis d = diagnose(*fit, {});
  const auto probability_of = [&](const char* name) {
    const auto found =
        std::ranges::find(d.candidates, name, [](const Candidate& c) { return label(c.request); });
    return found == d.candidates.end() ? 0.0 : found->in_any_form;
  };
  const double one = probability_of("bending_compliance 1");
  const double two = probability_of("bending_compliance 2");
  EXPECT_LT(std::max(one, two), kSurely) << one << " " << two;
  EXPECT_GT(one + two, 0.95) << one << " " << two;
  ASSERT_NE(d.recommended(), nullptr);
  EXPECT_EQ(d.recommended()->confounded_with.size(), 1U);
}

}  // namespace
}  // namespace armtrue
