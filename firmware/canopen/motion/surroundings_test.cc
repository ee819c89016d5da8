// How temperatures, payload and time, from objects and clock, act on the correction.
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "firmware/core/table/test_image.h"
#include "firmware/testing/drives_bench.h"

namespace armtrue::canopen {
namespace {

constexpr std::int32_t kTurn = 1 << 24;  // increments of the drives of TestImage

// Each joint is corrected by a quantity of its own: joints 1 to 3 by 0.1 mrad a degree of sensors 1
// to 3, joint 4 by 0.1 mrad a kilogram of payload, joint 5 by 0.4 µrad a second.
class SurroundingsTest : public ::testing::Test {
 protected:
  SurroundingsTest() {
    armtrue::tests::TestImage made(6);
    made.header()[format::header::kSensorCountAt] = 3;
    for (std::uint8_t sensor = 0; sensor < 3; ++sensor) {
      made.add(format::Section::kSensors, armtrue::tests::Bytes(format::sensor::kLength));
      made.add_state(format::State::kTemperature, sensor, 20);
      made.add_term(sensor, static_cast<std::uint16_t>(sensor + 1), 1e-4, 20);
    }
    made.add_state(format::State::kPayload, 0, 20);
    made.add_term(3, 4, 1e-4, 20);
    made.add_state(format::State::kTime, 0, 10);
    made.add_term(4, 5, 4e-7, 10);
    bench.install(made.image());
    bench.configure(Mode::kInline);
    for (int k = 0; k < 200; ++k) cycle();
  }
  void cycle() {
    bench.next_sync();
    bench.command_joints({});
  }
  // The correction of a joint in thousandths of a radian.
  double correction(std::uint16_t joint) {
    for (int k = 0; k < 300; ++k) cycle();
    const auto offset = static_cast<std::int32_t>(
        bench.read(static_cast<std::uint16_t>(0x60B0 + 0x800 * (joint - 1)), 0));
    return -1000.0 * 2.0 * M_PI * offset / kTurn;
  }

  // The error history, without its order.
  std::set<std::uint32_t> errors() {
    std::set<std::uint32_t> result;
    const std::uint32_t count = bench.read(0x1003, 0);
    for (std::uint8_t k = 1; k <= count; ++k) result.insert(bench.read(0x1003, k));
    return result;
  }

  NodeBench bench;
};

TEST_F(SurroundingsTest, Temperature_CorrectsTheJointOfItsSensor) {
  for (std::uint8_t sensor = 1; sensor <= 3; ++sensor) {
    SCOPED_TRACE(int{sensor});
    EXPECT_NEAR(correction(sensor), 0.0, 1e-3) << "not known: that of the reference";
    ASSERT_EQ(bench.write(0x2020, sensor, 1000, 2), 0U);  // 10 °C
    const double warm = correction(sensor);
    ASSERT_EQ(bench.write(0x2020, sensor, 3000, 2), 0U);  // 30 °C
    EXPECT_NEAR(std::abs(correction(sensor) - warm), 2.0, 1e-3);
  }
}

TEST_F(SurroundingsTest, SilentTemperature_CountsAsUnknownAfterTheTimeOut) {
  ASSERT_EQ(bench.write(0x2000, 6, 2000, 4), 0U);
  ASSERT_EQ(bench.write(0x2020, 2, 5000, 2), 0U);
  EXPECT_GT(std::abs(correction(2)), 2.0);
  for (int k = 0; k < 1300; ++k) cycle();
  EXPECT_GT(std::abs(correction(2)), 2.0) << "two seconds are not over before that";
  for (int k = 0; k < 300; ++k) cycle();
  EXPECT_NEAR(correction(2), 0.0, 1e-3);
}

TEST_F(SurroundingsTest, SilentSensor_DoesNotAffectOtherSensors) {
  ASSERT_EQ(bench.write(0x2000, 6, 2000, 4), 0U);
  ASSERT_EQ(bench.write(0x2020, 1, 5000, 2), 0U);
  for (int k = 0; k < 1000; ++k) cycle();
  ASSERT_EQ(bench.write(0x2020, 2, 5000, 2), 0U);
  for (int k = 0; k < 1100; ++k) cycle();
  EXPECT_GT(std::abs(correction(2)), 2.0) << "it was heard 1.4 s ago";
  EXPECT_NEAR(correction(1), 0.0, 1e-3);
}

TEST_F(SurroundingsTest, MissingInputsOfTheTable_AreReportedAfterTheTimeOut) {
  ASSERT_EQ(bench.write(0x2000, 6, 2000, 4), 0U);
  ASSERT_EQ(bench.write(0x2020, 1, 2000, 2), 0U);
  for (int k = 0; k < 1700; ++k) cycle();  // after the constructor's 200
  EXPECT_EQ(bench.read(0x1003, 0), 0U) << "two seconds are not over before that";
  for (int k = 0; k < 150; ++k) cycle();
  EXPECT_EQ(errors(), (std::set<std::uint32_t>{0x0002FF12, 0x0003FF12, 0x0000FF12}))
      << "two sensors, and the payload";
  for (const std::uint8_t sensor : std::initializer_list<std::uint8_t>{2, 3}) {
    ASSERT_EQ(bench.write(0x2020, sensor, 2000, 2), 0U);
  }
  EXPECT_NE(bench.read(0x1001, 0), 0U);
  ASSERT_EQ(bench.write(0x2021, 0, 0, 4), 0U) << "nothing is a payload, too";
  EXPECT_EQ(bench.read(0x1001, 0), 0U);
}

TEST_F(SurroundingsTest, PayloadWrittenOnce_DoesNotTimeOut) {
  ASSERT_EQ(bench.write(0x2000, 6, 500, 4), 0U);
  ASSERT_EQ(bench.write(0x2021, 0, 0, 4), 0U);
  for (int k = 0; k < 1000; ++k) {
    for (const std::uint8_t sensor : std::initializer_list<std::uint8_t>{1, 2, 3}) {
      ASSERT_EQ(bench.write(0x2020, sensor, 2000, 2), 0U);
    }
    cycle();
  }
  EXPECT_EQ(bench.read(0x1003, 0), 0U);
}

TEST_F(SurroundingsTest, UnreadInputs_AreNotReportedAsMissing) {
  ASSERT_EQ(bench.write(0x2000, 2, 0, 1), 0U);
  ASSERT_EQ(bench.write(0x2000, 6, 500, 4), 0U);
  for (int k = 0; k < 1000; ++k) cycle();
  EXPECT_EQ(bench.read(0x1003, 0), 0U) << "disabled";
  bench.power_on();
  ASSERT_EQ(bench.write(0x2000, 6, 500, 4), 0U);
  bench.run_for(1'000'000);
  EXPECT_EQ(bench.read(0x1003, 0), 0U) << "no set has gone out";
}

TEST_F(SurroundingsTest, Payload_IsInGrams) {
  const double empty = correction(4);
  ASSERT_EQ(bench.write(0x2021, 0, 3000, 4), 0U);
  EXPECT_NEAR(std::abs(correction(4) - empty), 0.3, 1e-3);
}

TEST_F(SurroundingsTest, Time_IsInMilliseconds) {
  const double before = correction(5);
  const std::uint64_t began_us = bench.now_us;
  bench.run_for(6'000'000'000, 1'000'000);
  const double after = correction(5);
  const double seconds = static_cast<double>(bench.now_us - began_us) * 1e-6;
  EXPECT_NEAR(std::abs(after - before), 4e-4 * seconds, 1e-3);
}

}  // namespace
}  // namespace armtrue::canopen
