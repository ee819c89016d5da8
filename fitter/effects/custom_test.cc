#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "fitter/effects/effect.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using testing::Problem;
using testing::Random;

// Of two reflectors, those that a custom term on `coordinate` moves.
std::vector<int> reflectors_moved_by(const std::string& coordinate) {
  Random random(5);
  const Problem p(testing::industrial_arm(), testing::geometry_model(), {40}, random,
                  [](const Parameter&) { return 0.0; });
  const EffectContext context{*p.state, 2};
  EffectRequest request;
  request.effect = "custom";
  request.options = {{"name", "sag"}, {"coordinate", coordinate}, {"expression", "q1"}};
  const EffectTerms built = find_effect("custom").build(context, request);
  std::vector<int> moved;
  for (const Term& term : built.parameters.front().terms) {
    EXPECT_EQ(term.coordinate.place, Place::kTool);
    moved.push_back(term.coordinate.index);
  }
  return moved;
}

TEST(Custom, ToolTermMovesAllReflectors_IndexedTermOnlyItsOwn) {
  EXPECT_EQ(reflectors_moved_by("tool.tx"), (std::vector<int>{0, 1}));
  EXPECT_EQ(reflectors_moved_by("tool[0].tx"), (std::vector<int>{0}));
  EXPECT_EQ(reflectors_moved_by("tool[1].tx"), (std::vector<int>{1}));
}

}  // namespace
}  // namespace armtrue
