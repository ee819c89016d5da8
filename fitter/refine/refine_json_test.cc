#include <gtest/gtest.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "fitter/refine/refine.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;

// The last entry of a model whose effect on joints 2 and 3 a search added, with these
// probabilities.
json effects_with(double of_joint_2, double of_joint_3) {
  testing::Random random(4);
  json model = testing::geometry_model();
  model["effects"].push_back({{"effect", "gear_harmonics"}, {"joints", {2, 3}}});
  const testing::Problem p(testing::industrial_arm(), model, {60, false, 1, 1e-5, 2e-5, {}}, random,
                           [](const Parameter&) { return 0.0; });
  RefineStep step;
  step.fit = Fit::run(p.robot, p.columns, ModelSpecification::from_json(model), {});
  step.diagnosis.probability_present = {{"gear_harmonics 2", of_joint_2},
                                        {"gear_harmonics 3", of_joint_3}};
  json effects = step.document()["effects"];
  effects.erase(
      effects.begin(),
      effects.begin() + static_cast<std::ptrdiff_t>(testing::geometry_model()["effects"].size()));
  return effects;
}

TEST(StepJson, JointsThatProbablyHaveTheEffectShareTheLeastProbability) {
  const json effects = effects_with(0.97, 0.8);
  ASSERT_EQ(effects.size(), 1U);
  EXPECT_EQ(effects[0]["joints"], json({2, 3}));
  EXPECT_EQ(effects[0]["probability"], 0.8);
}

// Tables of five joints that took an error from 448 to 108 um were given a probability below 1 %,
// which was that of the sixth.
TEST(StepJson, JointThatProbablyLacksTheEffectHasAnEntryOfItsOwn) {
  const json effects = effects_with(0.97, 0.01);
  ASSERT_EQ(effects.size(), 2U);
  EXPECT_EQ(effects[0]["joints"], json({2}));
  EXPECT_EQ(effects[0]["probability"], 0.97);
  EXPECT_EQ(effects[1]["effect"], "gear_harmonics");
  EXPECT_EQ(effects[1]["joints"], json({3}));
  EXPECT_EQ(effects[1]["probability"], 0.01);
}

}  // namespace
}  // namespace armtrue
