#include "firmware/core/evaluation/kinematics.h"

#include <gtest/gtest.h>

#include <array>

#include "firmware/core/table/table.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

TEST(KinematicsTest, CoupledPositions_AreRounded) {
  constexpr std::int32_t kOne = std::int32_t{1} << format::coupling::kRatioFraction;
  testing::TestImage made(3);
  for (const std::array<std::int32_t, 2> entry : {std::array{1, kOne}, std::array{2, kOne / 4}}) {
    testing::Bytes record = {static_cast<std::uint8_t>(entry[0]), 0, 0, 0};
    testing::append(record, entry[1]);
    made.add(format::Section::kCoupling, record);
  }
  const testing::Bytes image = made.image();
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
