#include "fitter/inference/identifiability.h"

#include <gtest/gtest.h>

#include <set>

#include "fitter/inference/cross_validation.h"
#include "fitter/solve/least_squares.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::nothing;
using testing::Problem;
using testing::ProblemOptions;
using testing::Random;

struct Result {
  Problem problem;
  Design design;
  Identifiability found;

  Result(const json& robot, const json& model, const ProblemOptions& options, Random& random)
      : problem(robot, model, options, random, nothing),
        design(problem.make_design()),
        found(identify(design)) {}

  // Kept parameters of the geometry, base and tool among them.
  int geometry() const {
    int count = 0;
    for (const int index : found.kept) {
      const std::string& effect = problem.model.parameters[static_cast<std::size_t>(index)].effect;
      count += effect == "joint_offset" || effect == "link_geometry" || effect == "base_frame" ||
               effect == "tool_offset";
    }
    return count;
  }

  std::string sentences() const {
    std::string all;
    for (const Unidentifiable& held : found.held) all += held.sentence + "\n";
    return all;
  }

  const Unidentifiable* held(const std::string& name) const {
    for (const Unidentifiable& h : found.held) {
      if (problem.model.parameters[static_cast<std::size_t>(h.parameter)].name == name) return &h;
    }
    return nullptr;
  }
};

// A complete, minimal and continuous geometry has four numbers a revolute joint, two a prismatic
// one, and six for the pose of the tool's frame in the last link's (Everett, Driels and Mooring
// 1987: N = 4R + 2P + 6). If only a point is measured, the three of its orientation have no effect.
struct Chain {
  int joints;
  std::vector<int> prismatic;
};
class GenericArm : public ::testing::TestWithParam<Chain> {};
INSTANTIATE_TEST_SUITE_P(Arms, GenericArm,
                         ::testing::Values(Chain{3, {}}, Chain{4, {}}, Chain{5, {}}, Chain{6, {}},
                                           Chain{7, {}}, Chain{6, {2}}, Chain{7, {0, 4}}));

TEST_P(GenericArm, PosesIdentify4RPlus2PPlus6Parameters) {
  const auto& [joints, prismatic] = GetParam();
  Random random(31);
  ProblemOptions options;
  options.rows = 150;
  options.with_rotation = true;
  const Result r(testing::random_chain(random, joints, prismatic), testing::geometry_model(),
                 options, random);
  const int sliding = static_cast<int>(prismatic.size());
  EXPECT_EQ(r.geometry(), 4 * (joints - sliding) + 2 * sliding + 6) << r.sentences();
}

TEST_P(GenericArm, PointsIdentifyThreeParametersFewer) {
  const auto& [joints, prismatic] = GetParam();
  Random random(32);
  ProblemOptions options;
  options.rows = 200;
  const Result r(testing::random_chain(random, joints, prismatic), testing::geometry_model(),
                 options, random);
  const int sliding = static_cast<int>(prismatic.size());
  EXPECT_EQ(r.geometry(), 4 * (joints - sliding) + 2 * sliding + 3) << r.sentences();
}

TEST(Identifiability, ParallelAxesAndWrist_KeepFourParametersAJoint) {
  Random random(33);
  ProblemOptions options;
  options.rows = 200;
  const Result r(testing::industrial_arm(), testing::geometry_model(), options, random);
  EXPECT_EQ(r.geometry(), 4 * 6 + 3) << r.sentences();
}

// The kept parameters must be able to represent the held ones: the fit is as good as with all
// parameters free.
TEST(Identifiability, KeptParametersRepresentTheHeldOnes) {
  Random random(34);
  ProblemOptions options;
  options.rows = 120;
  options.noise_m = 1e-7;
  for (const json& robot : {testing::industrial_arm(), testing::random_chain(random, 7),
                            testing::random_chain(random, 6, {2})}) {
    Problem p(robot, testing::geometry_model(), options, random, [&](const Parameter& q) {
      return testing::normal(random, q.unit == "m" ? 2e-4 : 5e-4);
    });
    Design design = p.make_design();
    design.set_free(identify(design).kept);
    solve(design, 1e-4);
    const double rms = summarise(residual_distances(design)).rms;
    // Holding parameters leaves out second-order products of the errors; the noise is a tenth of a
    // micrometre.
    EXPECT_LT(rms, 2e-6) << robot["name"];
  }
}

TEST(Identifiability, EquivalentParameters_SentenceNamesBoth) {
  Random random(35);
  ProblemOptions options;
  options.rows = 150;
  const Result r(testing::industrial_arm(), testing::geometry_model(), options, random);
  // Axis 1's zero acts like a turn of the base, axis 6's like a shift of the reflector about it.
  const Unidentifiable* first = r.held("joint_offset[1]");
  ASSERT_NE(first, nullptr);
  EXPECT_TRUE(first->exact);
  EXPECT_EQ(
      first->sentence,
      "axis 1's zero and the base's turn about z are one number: the first is held at nominal");
  const Unidentifiable* last = r.held("joint_offset[6]");
  ASSERT_NE(last, nullptr);
  EXPECT_TRUE(last->exact);
  EXPECT_NE(last->sentence.find("axis 6's zero and the tool's shift along"), std::string::npos)
      << last->sentence;
}

TEST(Identifiability, WithOrientations_LastZeroEqualsTheToolsTurn) {
  Random random(36);
  ProblemOptions options;
  options.rows = 150;
  options.with_rotation = true;
  Problem p(testing::industrial_arm(), testing::geometry_model(), options, random, nothing);
  Pose tool = Pose::Identity();  // turned like the flange, so that its z is axis 6
  tool.translation() = Eigen::Vector3d(0.1, 0.05, 0.1);
  p.kinematics->set_tool(0, tool);
  Design design = p.make_design();
  const Identifiability found = identify(design);
  std::string all;
  for (const Unidentifiable& h : found.held) all += h.sentence + "\n";
  EXPECT_NE(all.find("axis 6's zero and the tool's turn about z are one number"), std::string::npos)
      << all;
}

TEST(Identifiability, ReflectorOnTheLastAxis_LastZeroIsHeld) {
  Random random(37);
  ProblemOptions options;
  options.rows = 100;
  Problem p(testing::industrial_arm(), testing::geometry_model(), options, random, nothing);
  Pose tool = Pose::Identity();
  tool.translation() = Eigen::Vector3d(0.0, 0.0, 0.2);
  p.kinematics->set_tool(0, tool);
  Design design = p.make_design();
  bool found = false;
  for (const Unidentifiable& h : identify(design).held)
    found = found || h.sentence.find("axis 6's zero does not move the tool") == 0;
  EXPECT_TRUE(found);
}

// The axis of a joint that never moves is not observable and must not be fitted.
TEST(Identifiability, ConstantJoints_KeptParametersStaySmall) {
  Random random(38);
  json robot = testing::industrial_arm();
  robot["kinematics"]["joints"][4]["limits"] = {0.4, 0.4};
  robot["kinematics"]["joints"][2]["limits"] = {-0.2, -0.2};
  ProblemOptions options;
  options.rows = 150;
  options.noise_m = 1e-5;
  Problem p(robot, testing::geometry_model(), options, random, [&](const Parameter& q) {
    return testing::normal(random, q.unit == "m" ? 2e-4 : 5e-4);
  });
  Design design = p.make_design();
  const Identifiability found = identify(design);
  EXPECT_LT(found.kept.size(), 27u);
  design.set_free(found.kept);
  solve(design, 1e-4);
  for (const int index : found.kept) {
    const Parameter& q = p.model.parameters[static_cast<std::size_t>(index)];
    if (q.effect != "joint_offset" && q.effect != "link_geometry") continue;
    const double value = design.values()[static_cast<std::size_t>(index)];
    // A kept parameter represents several true errors, which add up; an undetermined one would
    // reach tens of millimetres, the width of its prior.
    EXPECT_LT(std::abs(value), q.unit == "m" ? 5e-3 : 1e-2) << q.name;
  }
  EXPECT_LT(summarise(residual_distances(design)).mean, 3e-5);
}

TEST(Identifiability, ScaleOfAConstantJoint_IsHeld) {
  Random random(39);
  json robot = testing::industrial_arm();
  robot["kinematics"]["joints"][3]["limits"] = {0.7, 0.7};
  json model = testing::geometry_model();
  model["effects"].push_back("joint_scale");
  ProblemOptions options;
  options.rows = 150;
  const Result r(robot, model, options, random);
  ASSERT_NE(r.held("joint_scale[4]"), nullptr) << r.sentences();
  EXPECT_EQ(r.held("joint_scale[2]"), nullptr) << r.sentences();
}

// Without masses in the robot file, moments of neighbouring links act on an axis as one number: of
// these regressors only a minimal set, the base parameters, can be kept.
TEST(Identifiability, GravityRegressorsKeepBaseParametersOnly) {
  Random random(40);
  json model = testing::geometry_model();
  model["effects"].push_back("joint_compliance");
  ProblemOptions options;
  options.rows = 300;
  const Result r(testing::industrial_arm(), model, options, random);
  int all = 0, kept = 0;
  for (const Parameter& p : r.problem.model.parameters) all += p.effect == "joint_compliance";
  for (const int i : r.found.kept)
    kept += r.problem.model.parameters[static_cast<std::size_t>(i)].effect == "joint_compliance";
  EXPECT_LT(kept, all);
  EXPECT_GE(kept, 4);
}

TEST(Identifiability, FewPoses_KeepFewerParameters) {
  Random random(41);
  ProblemOptions few, many;
  few.rows = 6;
  many.rows = 100;
  const Result poor(testing::industrial_arm(), testing::geometry_model(), few, random);
  const Result rich(testing::industrial_arm(), testing::geometry_model(), many, random);
  EXPECT_LE(poor.found.kept.size(), 18u);
  EXPECT_GT(rich.found.kept.size(), poor.found.kept.size());
}

TEST(Identifiability, EveryParameterIsEitherKeptOrHeldWithASentence) {
  Random random(42);
  ProblemOptions options;
  options.rows = 80;
  json model = testing::geometry_model();
  for (const char* effect : {"joint_scale", "gear_harmonics", "joint_compliance", "thermal_base"})
    model["effects"].push_back(effect);
  const Result r(testing::industrial_arm(), model, options, random);
  std::set<int> seen(r.found.kept.begin(), r.found.kept.end());
  for (const Unidentifiable& h : r.found.held) {
    EXPECT_TRUE(seen.insert(h.parameter).second);
    EXPECT_FALSE(h.sentence.empty());
  }
  EXPECT_EQ(seen.size(), r.problem.model.parameters.size());
}

}  // namespace
}  // namespace armtrue
