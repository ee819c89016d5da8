// Verdict, probabilities, recommendation and advice of a diagnosis say the same.
#include <gtest/gtest.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>

#include "fitter/refine/refine.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

constexpr double kReading = 8e-6;

bool any_starts_with(const json& sentences, const std::string& beginning) {
  return std::ranges::any_of(
      sentences, [&](const json& s) { return s.get<std::string>().starts_with(beginning); });
}

bool says(const json& candidate, const std::string& what) {
  return candidate["why"].get<std::string>().find(what) != std::string::npos;
}

// Candidates that the verdict need not count as missing: the fit has something in their place.
bool has_a_stand_in(const json& candidate) {
  return says(candidate, "in place of") || says(candidate, "the data cannot tell it");
}

// `told`: what `diagnose` writes, or `refine` for a step.
void expect_consistent(const json& told, const std::string& of) {
  const auto verdict = told["verdict"].get<std::string>();
  const auto nothing = told["probability_nothing"].get<double>();
  int recommended = 0;
  bool is_left_out = false;
  for (const json& c : told["candidates"]) {
    const auto probability = c["probability"].get<double>();
    recommended += c["recommend"].get<bool>() ? 1 : 0;
    is_left_out = is_left_out || (says(c, "was fitted") && probability > kMoreLikelyThanNot);
    if (c["recommend"].get<bool>()) {
      EXPECT_TRUE(says(c, "probability ")) << of << ": " << c["why"];
      const std::string command = "add it: armtrue add FIT " + c["effect"].get<std::string>() + " ";
      EXPECT_TRUE(any_starts_with(told["advice"], command)) << of << ": " << told["advice"];
    }
    if (probability <= kMoreLikelyThanNot || has_a_stand_in(c)) continue;
    EXPECT_NE(verdict, "nothing_missing") << of << ": " << c["effect"] << c["joints"];
    EXPECT_LE(probability + nothing, 1.0 + 1e-9) << of << ": " << c["effect"] << c["joints"];
  }
  EXPECT_EQ(recommended, verdict == "missing_effect" ? 1 : 0) << of;
  EXPECT_EQ(nothing >= kMoreLikelyThanNot, verdict == "nothing_missing") << of << ": " << nothing;
  EXPECT_EQ(told["unexplained"].empty(), verdict != "unexplained_structure") << of;
  EXPECT_EQ(any_starts_with(told["advice"], "add it: "), recommended == 1) << of;
  for (const json& e : told.value("effects", json::array()))
    EXPECT_EQ(e.contains("why"), e.value("probability", 1.0) <= kMoreLikelyThanNot) << of << e;
  if (verdict != "nothing_missing") {
    EXPECT_FALSE(any_starts_with(told["advice"], "nothing to add")) << of;
  }
  if (is_left_out && recommended == 0) {
    bool is_said = false;
    for (const json& sentence : told["advice"])
      is_said = is_said || sentence.get<std::string>().find("was fitted and left out") < 100;
    EXPECT_TRUE(is_said) << of << ": " << told["advice"];
  }
}

std::shared_ptr<Fit> fit_beside(std::uint64_t seed, const json& hidden, double size,
                                std::size_t poses) {
  Random random(seed);
  json truth = testing::geometry_model();
  for (const json& effect : hidden) truth["effects"].push_back(effect);
  const auto sizes = [&](const Parameter& p) {
    for (const json& effect : hidden) {
      if (p.effect == effect["effect"]) return size;
    }
    if (p.effect == "base_frame" || p.effect == "tool_offset") return 0.0;
    return testing::normal(random, p.unit == "m" ? 2e-4 : 5e-4);
  };
  const Problem p(testing::industrial_arm(), truth, {poses, false, 1, kReading, 2e-5, {}}, random,
                  sizes);
  return Fit::run(p.robot, p.columns, ModelSpecification::from_json(testing::geometry_model()), {});
}

struct Case {
  std::uint64_t seed;
  json hidden;
  double size;
  std::size_t poses = 100;
};

// Sizes from invisible to sure: the probabilities between are the ones that contradict.
std::vector<Case> cases() {
  const json backlash{{"effect", "backlash"}, {"joints", {3}}};
  const json waves{{"effect", "gear_harmonics"}, {"joints", {6}}};
  const json scale{{"effect", "joint_scale"}, {"joints", {2}}};
  return {{20, json::array(), 0.0},
          {20, json::array({backlash}), 5e-5},
          {24, json::array({backlash, waves}), 2.3e-5},
          {25, json::array({backlash, waves, scale}), 1e-4, 100},
          {31, json::array({backlash}), 4e-6},
          {32, json::array({backlash}), 6e-6, 50},
          {33, json::array({scale}), 1e-5, 50},
          {34, json::array({waves, scale}), 8e-6, 50}};
}

TEST(Consistency, DiagnosisAgreesWithItselfWhateverWasLeftOut) {
  for (const Case& c : cases()) {
    const auto fit = fit_beside(c.seed, c.hidden, c.size, c.poses);
    DiagnoseOptions options;
    for (int left = 0; left < 4; ++left) {
      const Diagnosis d = diagnose(*fit, options);
      expect_consistent(d.to_json(*fit), "seed " + std::to_string(c.seed) + ", " +
                                             std::to_string(left) + " candidates left out");
      if (!d.recommended()) break;
      options.left_out.insert(key_of(d.recommended()->request));
    }
  }
}

TEST(Consistency, StepsOfARefinementAgreeWithThemselvesAndWithADiagnosisOfTheLastFit) {
  for (const Case& c : cases()) {
    const std::vector<RefineStep> steps = refine(fit_beside(c.seed, c.hidden, c.size, c.poses), {});
    for (std::size_t s = 0; s < steps.size(); ++s)
      expect_consistent(steps[s].document(),
                        "seed " + std::to_string(c.seed) + ", step " + std::to_string(s));
    const RefineStep& last = steps.back();
    DiagnoseOptions options;
    for (const EffectRequest& request : removable_effects(*last.fit))
      options.searched.insert(label(request));
    for (const Candidate& candidate : last.diagnosis.candidates) {
      if (candidate.left_out) options.left_out.insert(key_of(candidate.request));
    }
    const auto read = Fit::run(last.fit->robot(), last.fit->state().columns(),
                               last.fit->specification(), last.fit->options());
    const Diagnosis again = diagnose(*read, options);
    EXPECT_EQ(again.verdict, last.diagnosis.verdict) << c.seed;
    EXPECT_NEAR(again.probability_nothing, last.diagnosis.probability_nothing, 0.05) << c.seed;
  }
}

}  // namespace
}  // namespace armtrue
