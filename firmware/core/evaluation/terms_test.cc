// Values of single slots; a correction shows only their sums.
#include "firmware/core/evaluation/terms.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <utility>

#include "firmware/core/table/table.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

TEST(TermsTest, SlotZero_IsOne_SignNodeIsPlusMinusOneOrZero) {
  tests::TestImage made(3);
  made.add_state(format::State::kDirection, 0, 30);
  tests::Bytes sign = {static_cast<std::uint8_t>(format::Node::kSign), 0, 0, 0, 1};
  sign.resize(format::node::kLength);
  made.add(format::Section::kNodes, sign);
  tests::put(made.header(), format::header::kConstantNodesAt, std::uint16_t{1});
  tests::put(made.header(), format::header::kSteepNodesAt, std::uint16_t{1});
  made.add_term(0, 2, 1e-3, 30);
  const tests::Bytes image = made.image();
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

// One node, in slot 2, over the payload in slot 1.
tests::Bytes with_payload_node(tests::Bytes node) {
  tests::TestImage made(3);
  made.add_state(format::State::kPayload, 0, 20);
  node.resize(format::node::kLength);
  made.add(format::Section::kNodes, node);
  tests::put(made.header(), format::header::kConstantNodesAt, std::uint16_t{1});
  tests::put(made.header(), format::header::kSteepNodesAt, std::uint16_t{1});
  return made.image();
}

TEST(TermsTest, SumNode_ShiftsItsPartsUpAndDown) {
  const tests::Bytes image =
      with_payload_node({static_cast<std::uint8_t>(format::Node::kSum), 0xFF, 2, 0, 1, 0, 1, 0});
  ASSERT_TRUE(validate(image, {}).accepted());
  const auto work = std::make_unique<TermWorkspace>();
  Surroundings around;
  around.payload = 100;
  begin_terms(TableView(image), around, *work);
  EXPECT_EQ(work->slots[2], 2 * 100 + 100 / 4);
}

TEST(TermsTest, SumNode_ShiftOfMoreThan31_IsRefused) {
  for (const int shift : {-31, 31, -32, 32}) {
    const Refusal refusal = shift % 31 == 0 ? Refusal::kNone : Refusal::kValueRange;
    const auto bits = static_cast<std::uint8_t>(shift);
    for (const auto& [first, second] :
         {std::pair{bits, std::uint8_t{0}}, std::pair{std::uint8_t{0}, bits}}) {
      const tests::Bytes image = with_payload_node(
          {static_cast<std::uint8_t>(format::Node::kSum), first, second, 0, 1, 0, 1, 0});
      EXPECT_EQ(validate(image, {}).refusal, refusal) << shift;
    }
  }
}

TEST(TermsTest, FirstSteepTerm_OnALink_IsRefused) {
  for (const std::uint8_t coordinate :
       {std::uint8_t{1}, std::uint8_t{format::kMotorCoordinates + 6}}) {
    tests::TestImage made(3);
    made.add_term(coordinate, 0, 1e-3, 30);
    tests::Bytes image = made.image();
    tests::put(image, format::header::kSteepTermsAt, std::uint16_t{1});
    tests::mend_checksum(image);
    EXPECT_EQ(validate(image, {}).refusal, coordinate == 1 ? Refusal::kNone : Refusal::kValueRange);
  }
}

TEST(TermsTest, PowerOfTwo_BeyondASlotsRange_IsFlagged) {
  tests::Bytes power = {static_cast<std::uint8_t>(format::Node::kPowerOfTwo), 20, 0, 0, 1, 0, 0, 0};
  tests::append(power, std::int32_t{20});
  const tests::Bytes image = with_payload_node(std::move(power));
  ASSERT_TRUE(validate(image, {}).accepted());
  for (const auto& [kilograms, is_held] :
       {std::pair{-45.0, true}, std::pair{0.0, true}, std::pair{10.5, true}, std::pair{11.0, false},
        std::pair{40.0, false}, std::pair{42.0, false}}) {
    const auto work = std::make_unique<TermWorkspace>();
    Surroundings around;
    around.payload = tests::fixed(kilograms, 20);
    begin_terms(TableView(image), around, *work);
    EXPECT_EQ(work->flags.is_saturated, !is_held) << kilograms;
    const double right = std::ldexp(std::exp2(kilograms), 20);
    EXPECT_NEAR(work->slots[2], is_held ? right : 2147483647.0, 1.0 + 1e-8 * right) << kilograms;
  }
}

TEST(TermsTest, PayloadOfGrams_IsInKilogramsTimes2To20) {
  EXPECT_EQ(payload_of_grams(0), 0);
  EXPECT_EQ(payload_of_grams(1000), 1 << 20);
  EXPECT_EQ(payload_of_grams(-1000), -(1 << 20));
}

TEST(TermsTest, SteepSums_BeginAtZero) {
  const tests::Bytes image = tests::TestImage(3).image();
  const auto work = std::make_unique<TermWorkspace>();
  MotorCoordinates steep;
  steep.fill({7});
  evaluate_steep_terms(TableView(image), {}, {}, *work, steep);
  for (const Coordinate& sum : steep) EXPECT_EQ(sum.raw, 0);
}

TEST(TermsTest, ToolConstant_ChangesOnlyItsCoordinate) {
  tests::TestImage made(3);
  made.add_constant(static_cast<std::uint8_t>(format::kToolCoordinates + 1), 1e-3);
  const tests::Bytes image = made.image();
  ASSERT_TRUE(validate(image, {}).accepted());
  const TableView table(image);
  const auto work = std::make_unique<TermWorkspace>();
  begin_terms(table, {}, *work);
  Coordinates coordinates;
  coordinates.fill({7});  // left from the previous cycle
  evaluate_smooth_terms(table, {}, {}, {}, *work, coordinates);
  for (std::size_t c = format::kToolCoordinates; c < format::kCoordinates; ++c) {
    const bool is_it = c == format::kToolCoordinates + 1;
    EXPECT_EQ(coordinates[c].raw, is_it ? tests::fixed(1e-3, Coordinate::fraction) : 0) << c;
  }
}

TEST(TermsTest, WaveOrHarmonic_MovesOnlyItsFrame) {
  tests::TestImage made(3);
  tests::Bytes wave = {format::kMotorCoordinates + 6 * 2};
  wave.resize(format::slow_wave::kLength);
  made.add(format::Section::kSlowWaves, wave);
  made.add_harmonic(format::kMotorCoordinates + 5, 1, 1.0, 0.0, 1e-4);
  const tests::Bytes image = made.image();
  const TableView table(image);
  for (std::size_t frame = 0; frame < 4; ++frame)
    EXPECT_EQ(table.has_motion(frame), frame == 0 || frame == 2) << frame;
}

}  // namespace
}  // namespace armtrue
