#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>
#include <set>

#include "fitter/plan/exchange.h"
#include "fitter/plan/menu.h"

namespace armtrue {
namespace {

using nlohmann::json;
using Rows = std::vector<std::size_t>;

Robot two_joints() {
  const json joint{{"name", "A"},      {"type", "revolute"}, {"xyz", {1.0, 0.0, 0.0}},
                   {"rpy", {0, 0, 0}}, {"offset", 0.0},      {"limits", {-2.0, 2.0}}};
  return Robot::from_json({{"name", "planar"},
                           {"kinematics",
                            {{"convention", "chain"},
                             {"joints", {joint, joint}},
                             {"end", {{"xyz", {1.0, 0.0, 0.0}}, {"rpy", {0, 0, 0}}}}}}});
}

// Random joints, and levels drawn at random for the other columns.
Menu menu_of(const Levels& levels, std::size_t rows, std::uint64_t seed) {
  std::mt19937_64 generator(seed);
  Menu menu;
  menu.uniform = rows;
  for (const char* joint : {"q1", "q2"}) {
    menu.written.push_back(joint);
    for (std::size_t i = 0; i < rows; ++i)
      menu.columns[joint].push_back(4.0 * uniform(generator) - 2.0);
  }
  for (const auto& [name, values] : levels) {
    menu.written.push_back(name);
    for (std::size_t i = 0; i < rows; ++i)
      menu.columns[name].push_back(values[generator() % values.size()]);
  }
  return menu;
}

std::vector<double> along(const Menu& menu, const std::string& column, const Rows& rows) {
  std::vector<double> values;
  for (const std::size_t row : rows) values.push_back(menu.columns.at(column)[row]);
  return values;
}

template <typename Value>
std::size_t changes(const std::vector<Value>& values) {
  std::size_t count = 0;
  for (std::size_t i = 1; i < values.size(); ++i) count += values[i] != values[i - 1] ? 1 : 0;
  return count;
}

std::size_t different(const std::vector<double>& values) {
  return std::set<double>(values.begin(), values.end()).size();
}

double way(const Menu& menu, const Rows& rows) {
  double sum = 0.0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    double longest = 0.0;
    for (const char* joint : {"q1", "q2"}) {
      const std::vector<double>& q = menu.columns.at(joint);
      longest = std::max(longest, std::abs(q[rows[i]] - q[rows[i - 1]]));
    }
    sum += longest;
  }
  return sum;
}

// `count` random rows of a mask.
Rows some_of(const std::vector<bool>& mask, std::size_t count, std::mt19937_64& generator) {
  Rows allowed;
  for (std::size_t row = 0; row < mask.size(); ++row) {
    if (mask[row]) allowed.push_back(row);
  }
  Rows rows;
  for (const std::size_t k : choose_random(allowed.size(), count, generator))
    rows.push_back(allowed[k]);
  return rows;
}

// Fewest payload changes over blocks in this order, by trying every order within each block.
std::size_t least_payload_changes(std::vector<std::vector<double>> blocks, std::size_t from = 0,
                                  std::vector<double> before = {}) {
  if (from == blocks.size()) return changes(before);
  std::size_t least = 1000;
  std::vector<double>& block = blocks[from];
  std::sort(block.begin(), block.end());
  do {
    std::vector<double> longer = before;
    longer.insert(longer.end(), block.begin(), block.end());
    least = std::min(least, least_payload_changes(blocks, from + 1, longer));
  } while (std::next_permutation(block.begin(), block.end()));
  return least;
}

const Levels kThermal{
    {"payload", {0.0, 8.0, 16.0}}, {"temp_arm", {20.0, 27.0, 33.0}}, {"time", {0.0, 3e3, 6e3}}};

TEST(Sessions, AnyChoiceFromOneSession_CanBeRun) {
  const Robot robot = two_joints();
  const Menu menu = menu_of(kThermal, 300, 1);
  const std::vector<std::vector<bool>> all = sessions(menu);
  ASSERT_GE(all.size(), 12U);
  std::mt19937_64 generator(2);
  for (const std::vector<bool>& session : all) {
    for (const std::size_t count : {3, 12, 60}) {
      const Rows rows = run_order(menu, robot, some_of(session, count, generator));
      const std::vector<double> time = along(menu, "time", rows);
      const std::vector<double> warmth = along(menu, "temp_arm", rows);
      EXPECT_TRUE(std::is_sorted(time.begin(), time.end()));
      EXPECT_EQ(changes(warmth), different(warmth) - 1);
      EXPECT_TRUE(std::is_sorted(warmth.begin(), warmth.end()) ||
                  std::is_sorted(warmth.rbegin(), warmth.rend()));
      for (std::size_t i = 1; i < rows.size(); ++i)
        EXPECT_TRUE(warmth[i] == warmth[i - 1] || time[i] > time[i - 1]);
    }
  }
}

TEST(Sessions, TogetherContainEveryRow_RisingAndFalling) {
  const Menu menu = menu_of(kThermal, 300, 3);
  std::vector<bool> reached(300, false);
  bool rising = false, falling = false;
  for (const std::vector<bool>& session : sessions(menu)) {
    for (std::size_t row = 0; row < 300; ++row) {
      reached[row] = reached[row] || session[row];
      if (!session[row] || menu.columns.at("time")[row] > 0.0) continue;
      rising = rising || menu.columns.at("temp_arm")[row] == 20.0;
      falling = falling || menu.columns.at("temp_arm")[row] == 33.0;
    }
  }
  EXPECT_EQ(std::count(reached.begin(), reached.end(), true), 300);
  EXPECT_TRUE(rising);
  EXPECT_TRUE(falling);
}

TEST(Sessions, WithoutLevelsOfTime_ThereIsOneSession) {
  Levels levels = kThermal;
  levels.erase("time");
  EXPECT_EQ(sessions(menu_of(levels, 50, 4)).size(), 1U);
  levels["time"] = {0.0};
  EXPECT_EQ(sessions(menu_of(levels, 50, 4)).size(), 1U);
}

TEST(Sessions, ManyLevels_GiveAtMost24Sessions) {
  Levels levels;
  for (int k = 0; k < 20; ++k) {
    levels["temp_arm"].push_back(15.0 + k);
    levels["time"].push_back(600.0 * k);
  }
  const std::vector<std::vector<bool>> all = sessions(menu_of(levels, 4000, 5));
  EXPECT_LE(all.size(), 24U);
  EXPECT_EQ(std::set(all.begin(), all.end()).size(), all.size());
}

TEST(RunOrder, PayloadChangesAreFewestForTemperatureAndTime) {
  const Robot robot = two_joints();
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const Menu menu = menu_of(kThermal, 200, seed);
    std::mt19937_64 generator(seed);
    const std::vector<std::vector<bool>> all = sessions(menu);
    const Rows chosen = some_of(all[seed % all.size()], 9, generator);
    const Rows rows = run_order(menu, robot, chosen);
    EXPECT_TRUE(std::is_permutation(rows.begin(), rows.end(), chosen.begin(), chosen.end()));
    std::vector<std::vector<double>> blocks;
    std::pair<double, double> last{-1.0, -1.0};
    for (const std::size_t row : rows) {
      const std::pair now{menu.columns.at("temp_arm")[row], menu.columns.at("time")[row]};
      if (now != last) blocks.emplace_back();
      last = now;
      const double mass = menu.columns.at("payload")[row];
      if (std::find(blocks.back().begin(), blocks.back().end(), mass) == blocks.back().end())
        blocks.back().push_back(mass);
    }
    EXPECT_EQ(changes(along(menu, "payload", rows)), least_payload_changes(blocks)) << seed;
  }
}

TEST(RunOrder, TravelIsBelow40PercentOfTheGivenOrder) {
  const Robot robot = two_joints();
  const Menu menu = menu_of({{"payload", {0.0, 8.0}}}, 80, 6);
  Rows by_payload(80);
  for (std::size_t row = 0; row < 80; ++row) by_payload[row] = row;
  std::stable_sort(by_payload.begin(), by_payload.end(), [&](std::size_t a, std::size_t b) {
    return menu.columns.at("payload")[a] < menu.columns.at("payload")[b];
  });
  const Rows rows = run_order(menu, robot, by_payload);
  EXPECT_EQ(changes(along(menu, "payload", rows)), 1U);
  EXPECT_LT(way(menu, rows), 0.4 * way(menu, by_payload));
}

TEST(RunOrder, ChangesThePayloadOnceAndGoesToTheNearest) {
  const Robot robot = two_joints();
  Menu menu;
  menu.written = {"q1", "q2", "payload"};
  menu.columns = {{"q1", {0.0, 1.0, 0.1, 0.9}},
                  {"q2", {0.0, 0.0, 0.0, 0.0}},
                  {"payload", {5.0, 0.0, 5.0, 0.0}}};
  EXPECT_EQ(run_order(menu, robot, {0, 1, 2, 3}), (Rows{1, 3, 2, 0}));
  menu.columns["payload"] = {0.0, 0.0, 0.0, 0.0};
  EXPECT_EQ(run_order(menu, robot, {0, 1, 2, 3}), (Rows{0, 2, 3, 1}));
}

}  // namespace
}  // namespace armtrue
