#include <gtest/gtest.h>

#include "fitter/effects/effect.h"
#include "fitter/testing/arms.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using testing::Problem;
using testing::Random;

TEST(TransmissionPwl, OfAJointThatSlidesIsALength) {
  Random random(5);
  const Problem p(testing::random_chain(random, 6, {0}), testing::geometry_model(), {40}, random,
                  [](const Parameter&) { return 0.0; });
  const EffectContext context{*p.state, 1, false};
  const Effect& effect = find_effect("transmission_pwl");
  EXPECT_EQ(effect.build(context, {effect.id(), {1}}).parameters.front().unit, "m");
  EXPECT_EQ(effect.build(context, {effect.id(), {2}}).parameters.front().unit, "rad");
}

}  // namespace
}  // namespace armtrue
