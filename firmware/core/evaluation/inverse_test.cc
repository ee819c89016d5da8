#include "firmware/core/evaluation/inverse.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <memory>

#include "firmware/core/evaluation/second_order.h"
#include "firmware/core/table/table.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

// One joint whose x is known exactly: x + offset + steep(x) + smooth(x) = target. Every term must
// be evaluated at the link position that the terms before it produced.
TEST(InverseTest, LinkTerms_AreEvaluatedAtTheMovedLink) {
  constexpr double kOffset = 5e-3;
  constexpr double kSteep = 1e-2;   // amplitude of sin 15 x; changes by 0.75 mrad over the offset
  constexpr double kSmooth = 1e-3;  // times sin 2 x
  tests::TestImage made(1);
  made.add_constant(0, kOffset);
  made.add_harmonic(0, format::node::kLinkAngle, 15.0, 0.0, kSteep);
  made.add_harmonic(0, format::node::kLinkAngle, 2.0, 0.0, kSmooth);
  tests::put(made.header(), format::header::kSteepHarmonicsAt, std::uint16_t{1});
  const tests::Bytes image = made.image();
  ASSERT_TRUE(validate(image, {}).accepted());
  const auto work = std::make_unique<Workspace>();
  const Correction correction = solve(TableView(image), {}, {}, *work);
  double x = 0.0;
  for (int i = 0; i < 100; ++i) {
    x = -kOffset - kSteep * std::sin(15.0 * x) - kSmooth * std::sin(2.0 * x);
  }
  constexpr double kUnits = 4294967296.0 / (2.0 * M_PI);
  EXPECT_NEAR(correction.delta[0], x * kUnits, 100);
}

constexpr double kLink = 0.5;
constexpr double kUnitsPerRadian = 4294967296.0 / (2.0 * M_PI);

// The tip of the planar arm of test_image.h.
std::array<double, 2> tip(const std::array<double, 3>& angles) {
  double x = 0.0, y = 0.0, turned = 0.0;
  for (const double angle : angles) {
    turned += angle;
    x += kLink * std::cos(turned);
    y += kLink * std::sin(turned);
  }
  return {x, y};
}

// The permitted share of a joint step of the arm stretched out along x.
double share_of(const std::array<double, 3>& turns) {
  const tests::Bytes image = tests::TestImage(3, kLink).image();
  const TableView table(image);
  JointMotions motions;
  joint_motions(table, {}, motions);
  Frames frames;
  const Frame tool = nominal_tool(table, motions, frames);
  JointStep step = {};
  for (std::size_t k = 0; k < 3; ++k) step[k].raw = tests::fixed(turns[k], Coordinate::fraction);
  return std::ldexp(straight_share(table, frames, tool.origin, step).raw, -Ratio::fraction);
}

TEST(SecondOrderTest, Share_LimitsTheBendToAnEighthOfThePath) {
  for (const double times : {0.5, 1.0, 3.0, 9.0}) {
    const std::array<double, 3> turns = {0.02 * times, -0.05 * times, 0.04 * times};
    const double a = turns[0], b = a + turns[1], c = b + turns[2];
    const double way = kLink * std::abs(a + b + c);
    const double bent = kLink / 2.0 * (a * a + b * b + c * c);
    EXPECT_NEAR(share_of(turns), std::min(1.0, way / bent / 8.0), 1e-5) << times;
  }
}

TEST(SecondOrderTest, StraightStep_IsTakenWhole) {
  EXPECT_EQ(share_of({0.01, 0.01, 0.01}), 1.0);
  EXPECT_EQ(share_of({0.0, 0.0, 0.0}), 1.0);
}

TEST(SecondOrderTest, StepWithoutToolMotion_IsNotTaken) {
  EXPECT_NEAR(share_of({0.1, -0.3, 0.3}), 0.0, 1e-6);
}

// An arm 10 mm too short hardly reaches the target: a step along the straight line would fold it.
TEST(InverseTest, NearlyStretchedArm_ErrorDoesNotGrow) {
  tests::TestImage made(3, kLink);
  made.add_constant(format::kMotorCoordinates, -0.01);  // the base's x
  tests::put(made.header(), format::header::kDampingAt, tests::fixed(0.006, 27));
  const tests::Bytes image = made.image();
  ASSERT_TRUE(validate(image, {}).accepted());
  const auto work = std::make_unique<Workspace>();
  double worst = 0.0;
  for (int i = -60; i <= 60; ++i) {
    const std::array<double, 3> target = {0.3, i * 0.005, -0.4 * i * 0.005};
    JointPositions at = {};
    for (std::size_t k = 0; k < 3; ++k) at[k].raw = std::llround(target[k] * kUnitsPerRadian);
    const Correction correction = solve(TableView(image), at, {}, *work);
    std::array<double, 3> corrected = target;
    for (std::size_t k = 0; k < 3; ++k) corrected[k] += correction.delta[k] / kUnitsPerRadian;
    const std::array<double, 2> wanted = tip(target), reached = tip(corrected);
    worst = std::max(worst, std::hypot(reached[0] - 0.01 - wanted[0], reached[1] - wanted[1]));
  }
  EXPECT_LE(worst, 0.01);
}

// Bars keep the last link of the planar arm level, with a small angular error; the two motors
// correct its effect at the tool. The third joint's angle follows from the bars.
TEST(InverseTest, PassiveJointError_IsCorrectedByTheOtherJoints) {
  constexpr double kOff = 8e-3;
  tests::TestImage made(3, kLink);
  made.section(format::Section::kJoints)[2 * format::joint::kLength + format::joint::kFlagsAt] =
      format::joint::kPassive;
  for (const std::uint8_t driving : {std::uint8_t{0}, std::uint8_t{1}}) {
    tests::Bytes coupling = {2, driving, 0, 0};
    tests::append(coupling, -(std::int32_t{1} << format::coupling::kRatioFraction));
    made.add(format::Section::kCoupling, coupling);
  }
  made.add_constant(2, kOff);
  const tests::Bytes image = made.image();
  ASSERT_TRUE(validate(image, {}).accepted());
  const auto work = std::make_unique<Workspace>();
  const auto level_tip = [](double q0, double q1, double off) {
    return tip({q0, q1, -q0 - q1 + off});
  };
  for (int i = 0; i < 40; ++i) {
    const double q0 = -1.0 + 0.05 * i, q1 = 0.7 + 0.03 * i;
    JointPositions at = {};
    at[0].raw = std::llround(q0 * kUnitsPerRadian);
    at[1].raw = std::llround(q1 * kUnitsPerRadian);
    const Correction correction = solve(TableView(image), at, {}, *work);
    EXPECT_EQ(correction.delta[2], 0);
    const auto wanted = level_tip(q0, q1, 0.0);
    const auto reached = level_tip(q0 + correction.delta[0] / kUnitsPerRadian,
                                   q1 + correction.delta[1] / kUnitsPerRadian, kOff);
    // 4 mm uncorrected. Damping leaves a share of it after one step, the share's square after two.
    EXPECT_LT(std::hypot(reached[0] - wanted[0], reached[1] - wanted[1]), 20e-6) << q0;
  }
}

}  // namespace
}  // namespace armtrue
