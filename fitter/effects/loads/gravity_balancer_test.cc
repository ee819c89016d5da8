#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "fitter/effects/effect.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using testing::Problem;
using testing::Random;

std::size_t candidates_where_alpha_is(double alpha) {
  Random random(5);
  nlohmann::json robot = testing::industrial_arm();
  robot["kinematics"]["joints"][1]["alpha"] = alpha;
  const Problem p(robot, testing::geometry_model(), {40}, random,
                  [](const Parameter&) { return 0.0; });
  const EffectContext context{*p.state, 1};
  return find_effect("gravity_balancer").tried(context).size();
}

TEST(GravityBalancer, JointWithoutGravityTorque_HasNoCandidates) {
  EXPECT_GT(candidates_where_alpha_is(-1.5707963267948966), 0u);
  EXPECT_EQ(candidates_where_alpha_is(0.0), 0u);
}

}  // namespace
}  // namespace armtrue
