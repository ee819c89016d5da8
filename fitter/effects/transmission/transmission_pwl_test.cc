#include <gtest/gtest.h>

#include <algorithm>

#include "fitter/effects/effect.h"
#include "fitter/testing/arms.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

TEST(TransmissionPwl, SlidingJoint_UnitIsMetre) {
  Random random(5);
  const Problem p(testing::random_chain(random, 6, {0}), testing::geometry_model(), {40}, random,
                  [](const Parameter&) { return 0.0; });
  const EffectContext context{*p.state, 1};
  const Effect& effect = find_effect("transmission_pwl");
  EXPECT_EQ(effect.build(context, {effect.id(), {1}}).parameters.front().unit, "m");
  EXPECT_EQ(effect.build(context, {effect.id(), {2}}).parameters.front().unit, "rad");
}

TEST(TransmissionPwl, ShortSlidingJoint_IsACandidate) {
  Random random(5);
  json robot = testing::random_chain(random, 4, {0});
  robot["kinematics"]["joints"][0]["limits"] = {0.0, 0.2};
  const Problem p(robot, testing::geometry_model(), {120}, random, testing::nothing);
  const auto all = find_effect("transmission_pwl").tried({*p.state, 1});
  EXPECT_TRUE(std::ranges::any_of(
      all, [](const EffectRequest& request) { return request.joints == std::vector{1}; }));
}

}  // namespace
}  // namespace armtrue
