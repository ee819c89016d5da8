#include <gtest/gtest.h>

#include <cmath>

#include "fitter/effects/effect.h"
#include "fitter/testing/arms.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using testing::Problem;
using testing::Random;

TEST(TrackerAngles, PointAtTheInstrument_TermsAreFinite) {
  // A row of zeros once made the terms read a variable named 'nan'.
  Random random(4);
  Problem p(testing::industrial_arm(), testing::geometry_model(), {40}, random, testing::nothing);
  for (const char* name : {"x", "y", "z"}) p.columns[name][7] = 0.0;
  const State state(p.robot, p.columns, p.kinematics->tool(0).translation());
  const EffectTerms terms = build_effect({state, 1}, {"tracker_angles", {}});
  for (const Parameter& q : terms.parameters) {
    for (const Term& term : q.terms) {
      for (const double value : state.values(term.basis))
        EXPECT_TRUE(std::isfinite(value)) << q.name;
    }
  }
}

}  // namespace
}  // namespace armtrue
