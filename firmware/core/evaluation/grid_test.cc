#include "firmware/core/evaluation/grid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "firmware/core/table/format.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

using tests::append;
using tests::Bytes;
using tests::fixed;

constexpr int kFraction = 28;

struct AxisSpec {
  std::vector<double> nodes;
  std::uint8_t flags;  // without kAxisExplicit, which follows from the nodes
};

bool is_uniform(const std::vector<double>& nodes) {
  for (std::size_t i = 2; i < nodes.size(); ++i) {
    if (std::abs((nodes[i] - nodes[i - 1]) - (nodes[1] - nodes[0])) > 1e-9) return false;
  }
  return true;
}

Bytes data_of(const std::vector<AxisSpec>& axes, std::size_t outputs,
              const std::vector<std::int16_t>& values, const std::vector<bool>& covered) {
  Bytes data = {static_cast<std::uint8_t>(axes.size()), static_cast<std::uint8_t>(outputs), 0, 0};
  for (std::size_t a = 0; a < axes.size(); ++a) {
    const std::vector<double>& nodes = axes[a].nodes;
    const bool uniform = is_uniform(nodes);
    append(data, static_cast<std::uint16_t>(a));
    append(data, static_cast<std::uint16_t>(nodes.size()));
    data.push_back(static_cast<std::uint8_t>(axes[a].flags | (uniform ? 0 : 1)));
    data.resize(data.size() + 3);
    const auto inverse = [](double step) {
      return static_cast<std::uint32_t>(std::llround(std::ldexp(1.0 / step, 52 - kFraction)));
    };
    for (std::size_t i = 0; i < (uniform ? 1 : nodes.size()); ++i)
      append(data, fixed(nodes[i], kFraction));
    for (std::size_t i = 1; i < (uniform ? 2 : nodes.size()); ++i)
      append(data, inverse(nodes[i] - nodes[i - 1]));
  }
  Bytes mask(4 * ((covered.size() + 31) / 32));
  for (std::size_t i = 0; i < covered.size(); ++i) {
    if (covered[i]) mask[i / 8] |= static_cast<std::uint8_t>(1U << (i % 8));
  }
  data.insert(data.end(), mask.begin(), mask.end());
  for (const std::int16_t value : values) append(data, value);
  return data;
}

double value_at(const Bytes& data, const std::vector<double>& at, bool* covered = nullptr,
                std::size_t output = 0) {
  std::vector<std::int32_t> slots;
  for (const double v : at) slots.push_back(fixed(v, kFraction));
  std::int32_t result[8] = {};
  const bool inside = interpolate(data.data(), slots.data(), result);
  if (covered != nullptr) *covered = inside;
  return std::ldexp(result[output], -12);
}

const AxisSpec kLine = {{-1.0, -0.5, 0.0, 0.5, 1.0}, 0};
const std::vector<std::int16_t> kLineValues = {100, -200, 300, 32767, -32768};
const std::vector<bool> kAll5(5, true);

TEST(GridTest, Line_PassesThroughItsNodes_IsLinearBetween) {
  const Bytes data = data_of({kLine}, 1, kLineValues, kAll5);
  for (std::size_t i = 0; i < 5; ++i)
    EXPECT_NEAR(value_at(data, {kLine.nodes[i]}), kLineValues[i], 0.1);
  EXPECT_NEAR(value_at(data, {-0.75}), -50.0, 0.01);
  EXPECT_NEAR(value_at(data, {0.9}), 32767 - 0.8 * 65535, 0.1);
}

TEST(GridTest, Line_BeyondItsEnds_FadesToZeroWithinOneCell) {
  const Bytes data = data_of({kLine}, 1, kLineValues, kAll5);
  bool covered = true;
  EXPECT_NEAR(value_at(data, {-1.25}, &covered), 50.0, 0.01);
  EXPECT_FALSE(covered);
  EXPECT_EQ(value_at(data, {-1.5}), 0.0);
  EXPECT_EQ(value_at(data, {-7.9}), 0.0);
  EXPECT_NEAR(value_at(data, {1.25}), -16384.0, 0.1);
  EXPECT_EQ(value_at(data, {7.9}), 0.0);
  value_at(data, {0.3}, &covered);
  EXPECT_TRUE(covered);
}

TEST(GridTest, HoldFlags_KeepEndValuesBeyondTheEnds) {
  const AxisSpec held = {kLine.nodes, format::grid::kAxisHoldLow | format::grid::kAxisHoldHigh};
  const Bytes data = data_of({held}, 1, kLineValues, kAll5);
  bool covered = false;
  EXPECT_EQ(value_at(data, {-5.0}, &covered), 100.0);
  EXPECT_TRUE(covered);
  EXPECT_EQ(value_at(data, {5.0}), -32768.0);
}

TEST(GridTest, UncoveredNode_IsZero_ValuesStayContinuous) {
  const std::vector<bool> covered = {true, true, false, true, true};
  const Bytes data = data_of({kLine}, 1, {100, 200, 0, 400, 500}, covered);
  bool inside = true;
  EXPECT_NEAR(value_at(data, {0.0}, &inside), 0.0, 0.01);
  EXPECT_FALSE(inside);
  EXPECT_NEAR(value_at(data, {-0.25}, &inside), 100.0, 0.01);
  EXPECT_FALSE(inside);
  value_at(data, {-0.75}, &inside);
  EXPECT_TRUE(inside);
}

TEST(GridTest, UnevenNodesInterpolateLikeEvenOnes) {
  const AxisSpec uneven = {{-1.0, -0.9, 0.3, 0.35, 2.0}, 0};
  const Bytes data = data_of({uneven}, 1, {0, 1000, -1000, 500, 0}, kAll5);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_NEAR(value_at(data, {uneven.nodes[i]}), (std::vector{0, 1000, -1000, 500, 0})[i], 0.1);
  }
  EXPECT_NEAR(value_at(data, {-0.3}), 0.0, 0.1);
  EXPECT_NEAR(value_at(data, {0.325}), -250.0, 0.1);
}

TEST(GridTest, LineOf33Nodes_HasTheRightValueAtEachNode) {
  AxisSpec axis = {{}, 0};
  std::vector<std::int16_t> values;
  for (int i = 0; i < 33; ++i) {
    axis.nodes.push_back(-2.0 + 0.125 * i);
    values.push_back(static_cast<std::int16_t>(100 * i));
    values.push_back(static_cast<std::int16_t>(-300 * i));
  }
  const Bytes data = data_of({axis}, 2, values, std::vector<bool>(33, true));
  for (int i = 0; i < 33; ++i) {
    const std::vector<double> at = {axis.nodes[static_cast<std::size_t>(i)]};
    EXPECT_NEAR(value_at(data, at), 100.0 * i, 0.01);
    EXPECT_NEAR(value_at(data, at, nullptr, 1), -300.0 * i, 0.01);
  }
}

TEST(GridTest, SumOverCellCorners_RoundsToNearest) {
  // The far corner's weight is 32767 or 32768 of 2^16 steps of the result.
  const AxisSpec line = {{0.0, 1.0}, 0};
  const Bytes data = data_of({line, line}, 1, {0, 0, 0, 1}, std::vector<bool>(4, true));
  EXPECT_EQ(value_at(data, {std::ldexp(1.0, -8), std::ldexp(32767.0, -20)}), 0.0);
  EXPECT_EQ(value_at(data, {std::ldexp(1.0, -8), std::ldexp(32768.0, -20)}), std::ldexp(1.0, -12));
}

TEST(GridTest, Cell_IsCoveredOnlyIfAllItsCornersAre) {
  const AxisSpec line = {{0.0, 1.0}, 0};
  for (std::size_t gap = 0; gap <= 4; ++gap) {
    std::vector<bool> covered(4, true);
    if (gap < 4) covered[gap] = false;
    const Bytes data = data_of({line, line}, 1, {0, 0, 0, 0}, covered);
    bool inside = gap != 4;
    value_at(data, {0.3, 0.6}, &inside);
    EXPECT_EQ(inside, gap == 4) << gap;
  }
}

class ManyAxes : public ::testing::TestWithParam<std::size_t> {};

TEST_P(ManyAxes, AgreesWithDoublePrecisionEverywhereAndIsContinuous) {
  const std::size_t axes = GetParam();
  const std::size_t outputs = 3;
  std::vector<AxisSpec> specs;
  std::size_t nodes = 1;
  for (std::size_t a = 0; a < axes; ++a) {
    specs.push_back({{-1.5, -0.5, 0.5, 1.5}, 0});
    nodes *= 4;
  }
  std::mt19937 random(4);
  std::vector<std::int16_t> values(nodes * outputs);
  for (std::int16_t& v : values) v = static_cast<std::int16_t>(random());
  const Bytes data = data_of(specs, outputs, values, std::vector<bool>(nodes, true));

  const auto exact = [&](const std::vector<double>& at, std::size_t output) {
    double total = 0.0;
    for (std::size_t corner = 0; corner < (std::size_t{1} << axes); ++corner) {
      double weight = 1.0;
      std::size_t node = 0;
      for (std::size_t a = 0; a < axes; ++a) {
        const double place = std::clamp(at[a] + 1.5, -1.0, 4.0);
        const double inside = std::clamp(place, 0.0, 3.0);
        const auto cell = static_cast<std::size_t>(std::min(2.0, std::floor(inside)));
        const double within = inside - static_cast<double>(cell);
        weight *= std::max(0.0, 1.0 - std::abs(place - inside));
        const bool far = ((corner >> a) & 1U) != 0U;
        weight *= far ? within : 1.0 - within;
        node = node * 4 + cell + (far ? 1 : 0);
      }
      total += weight * values[node * outputs + output];
    }
    return total;
  };
  std::uniform_real_distribution<double> anywhere(-3.0, 3.0);
  for (int i = 0; i < 3000; ++i) {
    std::vector<double> at;
    for (std::size_t a = 0; a < axes; ++a) at.push_back(anywhere(random));
    for (std::size_t o = 0; o < outputs; ++o)
      EXPECT_NEAR(value_at(data, at, nullptr, o), exact(at, o), 0.3);
    // The slope is at most 65535 units per cell of 1 rad and axis; the step is 1e-7 rad.
    std::vector<double> beside = at;
    for (double& v : beside) v += 1e-7;
    EXPECT_NEAR(value_at(data, beside), value_at(data, at), 0.1);
  }
}

INSTANTIATE_TEST_SUITE_P(Axes, ManyAxes,
                         ::testing::Values(std::size_t{1}, std::size_t{2}, std::size_t{3},
                                           std::size_t{4}));

}  // namespace
}  // namespace armtrue
