#include "firmware/core/evaluation/kinematics.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <utility>

#include "firmware/core/table/table.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

bool operator==(const Vector& a, const Vector& b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

// A constant turn of the first link about z.
tests::Bytes with_turn(double radian) {
  tests::TestImage made(3);
  made.add_constant(format::kMotorCoordinates + 6 + 5, radian);
  return made.image();
}

TEST(KinematicsTest, RevoluteJoints_HaveNoSlide) {
  const tests::Bytes image = tests::TestImage(3).image();
  const TableView table(image);
  JointMotions motions;
  joint_motions(table, {}, motions);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(motions[k].slide, 0);
    EXPECT_EQ(motions[k].cosine, kRatioOne.raw);
  }
}

TEST(KinematicsTest, HasLargeTurn_FromTwoMilliradians_OfThatFrameOnly) {
  for (const auto& [radian, is_large] : {std::pair{1.9e-3, false}, std::pair{2.0e-3, true},
                                         std::pair{-1.9e-3, false}, std::pair{-2.0e-3, true}}) {
    const tests::Bytes image = with_turn(radian);
    const TableView table(image);
    for (std::size_t frame = 0; frame <= 4; ++frame) {
      EXPECT_EQ(table.has_large_turn(frame), is_large && frame == 1) << radian << ' ' << frame;
    }
  }
}

TEST(KinematicsTest, TurnOfTenMilliradians_IsExactToItsFourthOrder) {
  constexpr double kTurn = 1e-2;
  const tests::Bytes image = with_turn(kTurn);
  const TableView table(image);
  JointMotions motions;
  joint_motions(table, {}, motions);
  Coordinates coordinates = {};
  coordinates[format::kMotorCoordinates + 6 + 5] = {tests::fixed(kTurn, Coordinate::fraction)};
  const Vector point = real_tool(table, motions, coordinates).point;
  // Three links of 0.5 m turn about the first joint; to second order they would be 0.25 µm off.
  EXPECT_NEAR(std::ldexp(point.x, -Length::fraction), 1.5 * std::cos(kTurn), 1.5e-8);
  EXPECT_NEAR(std::ldexp(point.y, -Length::fraction), 1.5 * std::sin(kTurn), 1.5e-8);
}

TEST(KinematicsTest, SmallTurns_RoundEveryComponentToNearest) {
  // r × v is 3; half of it rounds to 2, and r × 2 is 0.6, rounded to 1.
  const std::int32_t r = tests::fixed(0.3, 30);
  EXPECT_TRUE(rotate_small({r, 0, 0}, {0, 10, 0}) == (Vector{0, 9, 3}));
  EXPECT_TRUE(rotate_small({0, r, 0}, {0, 0, 10}) == (Vector{3, 0, 9}));
  EXPECT_TRUE(rotate_small({0, 0, r}, {10, 0, 0}) == (Vector{9, 3, 0}));
}

TEST(KinematicsTest, CoupledPositions_AreRounded) {
  constexpr std::int32_t kOne = std::int32_t{1} << format::coupling::kRatioFraction;
  tests::TestImage made(3);
  for (const std::array<std::int32_t, 2> entry : {std::array{1, kOne}, std::array{2, kOne / 4}}) {
    tests::Bytes record = {static_cast<std::uint8_t>(entry[0]), 0, 0, 0};
    tests::append(record, entry[1]);
    made.add(format::Section::kCoupling, record);
  }
  const tests::Bytes image = made.image();
  ASSERT_TRUE(validate(image, {}).accepted());
  const TableView table(image);
  JointPositions link;
  for (const auto& [driving, quarter] :
       {std::array{4, 1}, std::array{5, 1}, std::array{6, 2}, std::array{7, 2}, std::array{-5, -1},
        std::array{-7, -2}}) {
    JointPositions motor = {};
    motor[0] = {driving};
    link_positions(table, motor, link);
    EXPECT_EQ(link[0].raw, driving);
    EXPECT_EQ(link[1].raw, driving);
    EXPECT_EQ(link[2].raw, quarter) << driving;
  }
}

}  // namespace
}  // namespace armtrue
