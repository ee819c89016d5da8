// Properties that hold for every table and every stream of commands, on random ones: pass-through,
// limits, blends, switching, feedback, continuity across cells, masks and the wrap at half a turn.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "firmware/core/compensator.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

using tests::Bytes;
using tests::kIncrementsPerRadian;
using tests::kJoints;
using tests::TestImage;

constexpr std::int32_t kIncrementsPerTurn = 1 << 24;
constexpr int kTableNodes = 17;
constexpr double kTableFirst = -2.0;
constexpr double kTableStep = 0.25;

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double real(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  int integer(int low, int high) { return std::uniform_int_distribution<int>(low, high)(engine_); }
  bool once_in(int times) { return integer(1, times) == 1; }

 private:
  std::mt19937 engine_;
};

struct RandomTable {
  Bytes image;
  std::int32_t magnitude;  // of joint 0, 2^-32 turn
  std::int32_t rate;       // of joint 0, 2^-32 turn per second
  double steepest = 0.0;   // largest slope of all its terms on a motor, rad/rad
};

// Random constants on motors and links, harmonics, and tables with uncovered nodes; random limits,
// some of them tight.
RandomTable random_table(Random& random, bool with_links) {
  TestImage made(kJoints);
  RandomTable result;
  if (with_links) {
    for (int i = random.integer(0, 4); i > 0; --i) {
      made.add_constant(
          static_cast<std::uint8_t>(8 + 6 * random.integer(0, 3) + random.integer(0, 5)),
          random.real(-1e-3, 1e-3));
    }
  }
  for (int i = random.integer(0, 3); i > 0; --i) {
    made.add_constant(static_cast<std::uint8_t>(random.integer(0, 2)), random.real(-5e-3, 5e-3));
  }
  for (int i = random.integer(0, 4); i > 0; --i) {
    const int order = random.integer(1, 20);
    const double amplitude = random.real(-1e-3, 1e-3);
    const auto joint = static_cast<std::uint8_t>(random.integer(0, 2));
    made.add_harmonic(joint, joint, order, random.real(0.0, 1.0), amplitude);
    result.steepest += std::abs(order * amplitude);
  }
  for (int i = random.integer(0, 2); i > 0; --i) {
    std::vector<double> values;
    for (int n = 0; n < kTableNodes; ++n) values.push_back(random.real(-1e-3, 1e-3));
    made.add_table(static_cast<std::uint8_t>(random.integer(0, 2)), kTableFirst, kTableStep, values,
                   22, static_cast<std::uint32_t>(random.integer(0, 0x1FFFF)));
    result.steepest += 2e-3 / kTableStep;
  }
  result.magnitude = random.once_in(3) ? random.integer(1 << 14, 1 << 22) : kMaxDeltaRevolute;
  result.rate = random.once_in(3) ? random.integer(1 << 18, 1 << 26) : kMaxRateRevolute;
  Bytes& joints = made.section(format::Section::kJoints);
  tests::put(joints, format::joint::kMagnitudeAt, result.magnitude);
  tests::put(joints, format::joint::kRateAt, result.rate);
  result.image = made.image();
  return result;
}

class PropertyTest : public ::testing::TestWithParam<unsigned> {};

TEST_P(PropertyTest, Output_UnderRandomRequests_StaysWithinLimits) {
  Random random(GetParam());
  const std::uint32_t cycle_us = random.once_in(2) ? 1000 : 4000;
  Compensator compensator({.joint_count = kJoints, .cycle_us = cycle_us});
  const RandomTable tables[2] = {random_table(random, true), random_table(random, true)};
  Bytes broken = tables[0].image;
  broken[static_cast<std::size_t>(random.integer(0, static_cast<int>(broken.size()) - 1))] ^= 0x10U;

  const RandomTable* active = nullptr;
  CycleInput input;
  std::array<double, kJoints> position = {random.real(-3.2, 3.2), random.real(-3.2, 3.2), 1.0};
  std::array<std::int32_t, kMaxJoints> last = {};
  int since_disabled = 0;
  for (int i = 0; i < 1500; ++i) {
    if (random.once_in(120)) {
      const int which = random.integer(0, 3);
      if (which < 2 && compensator.load(tables[which].image, {}).accepted()) {
        ASSERT_TRUE(compensator.activate());
        active = &tables[which];
      } else if (which == 2) {
        compensator.disable();
        active = nullptr;
        since_disabled = 0;
      } else {
        ASSERT_FALSE(compensator.load(broken, {}).accepted());
      }
    }
    for (std::size_t k = 0; k < kJoints; ++k) {
      position[k] += random.real(-4e-3, 4e-3);
      input.target[k] = static_cast<std::int32_t>(std::lround(position[k] * kIncrementsPerRadian));
    }
    input.temperature_valid = static_cast<std::uint32_t>(random.integer(0, 255));
    input.payload_g = random.integer(-1000, 100000);
    const CycleOutput output = compensator.cycle(input);

    // While one table replaces the other, the larger of their limits applies.
    const auto of_both = [&tables](auto member) {
      return static_cast<double>(std::max(tables[0].*member, tables[1].*member));
    };
    const double largest = of_both(&RandomTable::magnitude) / 256.0 + 2.0;
    // A fade to zero takes kFadeCycles at most, even if the permitted rate would take longer.
    const double fade = std::max(largest, 1.0) / Compensator::kFadeCycles;
    const double permitted = of_both(&RandomTable::rate) / 256.0 * cycle_us * 1e-6;
    const double step = (active == nullptr ? std::max(permitted, fade) : permitted) + 3.0;
    ASSERT_LE(std::abs(output.delta[0]), largest);
    ASSERT_LE(std::abs(output.delta[0] - last[0]), step) << "cycle " << i;
    for (std::size_t k = 0; k < kJoints; ++k) {
      ASSERT_EQ(output.corrected[k], input.target[k] + output.delta[k]);
      ASSERT_EQ(compensator.correction_of(output.cycle, k), output.delta[k]);
      if (output.state == CompensatorState::kPassThrough) {
        ASSERT_EQ(output.delta[k], 0);
      }
    }
    // Blending takes 100 ms, longer only if a tight rate limits it.
    const bool is_off =
        active == nullptr && ++since_disabled > 1 + static_cast<int>(110000 / cycle_us);
    if (is_off && tables[0].rate == kMaxRateRevolute && tables[1].rate == kMaxRateRevolute) {
      ASSERT_EQ(output.state, CompensatorState::kPassThrough) << "cycle " << i;
    }
    last = output.delta;
  }
}

TEST_P(PropertyTest, TheCorrectionIsContinuousAcrossCellsMasksAndHalfATurn) {
  Random random(GetParam() + 1000);
  Compensator compensator({.joint_count = kJoints});
  RandomTable table = random_table(random, false);
  while (table.magnitude != kMaxDeltaRevolute || table.rate != kMaxRateRevolute) {
    table = random_table(random, false);
  }
  ASSERT_TRUE(compensator.load(table.image, {}).accepted());
  ASSERT_TRUE(compensator.activate());
  CycleInput input;
  input.target[1] = 4000000;
  // Through the whole table, beyond its ends, and across ±180 degrees.
  const double step = 2e-4;
  const double begin = random.real(-3.6, -3.4);
  const auto at = [&](double q) {
    input.target[0] = static_cast<std::int32_t>(std::lround(q * kIncrementsPerRadian));
    return compensator.cycle(input).delta[0];
  };
  std::int32_t last = 0;
  for (int i = 0; i < 300; ++i) last = at(begin);
  const double most = 1.2 * table.steepest * step * kIncrementsPerRadian + 3.0;
  for (double q = begin; q < 3.6; q += step) {
    const std::int32_t delta = at(q);
    ASSERT_LE(std::abs(delta - last), most) << q;
    last = delta;
  }
}

TEST_P(PropertyTest, Harmonics_RepeatAfterAWholeTurn) {
  Random random(GetParam() + 2000);
  Compensator compensator({.joint_count = kJoints});
  TestImage made(kJoints);
  for (std::uint8_t joint = 0; joint < kJoints; ++joint) {
    made.add_harmonic(joint, joint, random.integer(1, 60), random.real(0.0, 1.0),
                      random.real(-1e-4, 1e-4));
  }
  const Bytes image = made.image();
  ASSERT_TRUE(compensator.load(image, {}).accepted());
  ASSERT_TRUE(compensator.activate());
  CycleInput input;
  for (int i = 0; i < 300; ++i) compensator.cycle(input);
  for (int i = 0; i < 50; ++i) {
    // Close to half a turn, from both sides.
    const std::int32_t q = kIncrementsPerTurn / 2 + random.integer(-5000, 5000);
    std::array<std::int32_t, 2> delta = {};
    for (const int turn : {0, 1}) {
      input.target[0] = q - turn * kIncrementsPerTurn;
      for (int settle = 0; settle < 5; ++settle) delta[turn] = compensator.cycle(input).delta[0];
    }
    ASSERT_NEAR(delta[0], delta[1], 1);
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, PropertyTest, ::testing::Range(0U, 60U));

}  // namespace
}  // namespace armtrue
