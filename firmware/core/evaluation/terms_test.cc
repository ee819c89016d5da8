// Values of single slots, of which a correction shows only sums.
#include "firmware/core/evaluation/terms.h"

#include <gtest/gtest.h>

#include <memory>

#include "firmware/core/table/table.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

TEST(TermsTest, TheConstantOne_IsInSlotZero_AndSignsAreWhole) {
  testing::TestImage made(3);
  made.add_state(format::State::kDirection, 0, 30);
  testing::Bytes sign = {static_cast<std::uint8_t>(format::Node::kSign), 0, 0, 0, 1};
  sign.resize(format::node::kLength);
  made.add(format::Section::kNodes, sign);
  testing::put(made.header(), format::header::kConstantNodesAt, std::uint16_t{1});
  testing::put(made.header(), format::header::kSteepNodesAt, std::uint16_t{1});
  made.add_term(0, 2, 1e-3, 30);
  const testing::Bytes image = made.image();
  ASSERT_TRUE(validate(image, {}).accepted());
  const TableView table(image);
  const auto work = std::make_unique<TermWorkspace>();
  for (int direction = -1; direction <= 1; ++direction) {
    Surroundings around;
    around.direction[0] = static_cast<std::int8_t>(direction);
    begin_terms(table, around, *work);
    EXPECT_EQ(work->slots[0], kRatioOne.raw);
    EXPECT_EQ(work->slots[2], direction * kRatioOne.raw);
  }
}

TEST(TermsTest, ASum_ShiftsUpAndDown) {
  testing::TestImage made(3);
  made.add_state(format::State::kPayload, 0, 20);
  testing::Bytes sum = {static_cast<std::uint8_t>(format::Node::kSum), 0xFF, 2, 0, 1, 0, 1, 0};
  sum.resize(format::node::kLength);
  made.add(format::Section::kNodes, sum);
  testing::put(made.header(), format::header::kConstantNodesAt, std::uint16_t{1});
  testing::put(made.header(), format::header::kSteepNodesAt, std::uint16_t{1});
  const testing::Bytes image = made.image();
  ASSERT_TRUE(validate(image, {}).accepted());
  const auto work = std::make_unique<TermWorkspace>();
  Surroundings around;
  around.payload = 100;
  begin_terms(TableView(image), around, *work);
  EXPECT_EQ(work->slots[2], 2 * 100 + 100 / 4);
}

TEST(TermsTest, WavesAndHarmonics_MoveTheirFramesAlone) {
  testing::TestImage made(3);
  testing::Bytes wave = {format::kMotorCoordinates + 6 * 2};
  wave.resize(format::slow_wave::kLength);
  made.add(format::Section::kSlowWaves, wave);
  made.add_harmonic(format::kMotorCoordinates + 5, 1, 1.0, 0.0, 1e-4);
  const testing::Bytes image = made.image();
  const TableView table(image);
  for (std::size_t frame = 0; frame < 4; ++frame)
    EXPECT_EQ(table.has_motion(frame), frame == 0 || frame == 2) << frame;
}

}  // namespace
}  // namespace armtrue
