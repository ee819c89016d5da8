#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "fitter/plan/menu.h"

namespace armtrue {
namespace {

// Most sessions tried for each direction of the temperature, rising and falling.
constexpr double kMostSessions = 12.0;

using Temperatures = std::vector<double>;  // of all sensors

std::vector<Temperatures> temperatures_of(const Menu& menu, std::size_t rows) {
  std::vector<Temperatures> result(rows);
  for (const std::string& name : menu.written) {
    if (!name.starts_with("temp_")) continue;
    for (std::size_t row = 0; row < rows; ++row) result[row].push_back(menu.columns.at(name)[row]);
  }
  return result;
}

// Zeros where the column is not on the menu.
std::vector<double> column_or_none(const Menu& menu, const std::string& name, std::size_t rows) {
  const auto at = std::find(menu.written.begin(), menu.written.end(), name);
  return at == menu.written.end() ? std::vector<double>(rows, 0.0) : menu.columns.at(name);
}

std::size_t row_count(const Menu& menu) { return menu.columns.at(menu.written.front()).size(); }

double binomial(std::size_t n, std::size_t k) {
  double result = 1.0;
  for (std::size_t i = 0; i < k; ++i)
    result *= static_cast<double>(n - i) / static_cast<double>(i + 1);
  return std::round(result);
}

// Levels from 0 to `highest` at each of `moments`, never falling: the course of the given rank
// among all such courses.
std::vector<std::size_t> course(std::size_t highest, std::size_t moments, double rank) {
  std::vector<std::size_t> levels;
  std::size_t level = 0;
  while (levels.size() < moments) {
    const std::size_t rest = moments - levels.size();
    const double higher = level < highest ? binomial(highest - level - 1 + rest, rest) : 0.0;
    if (rank < higher) {
      ++level;
    } else {
      rank -= higher;
      levels.push_back(level);
    }
  }
  return levels;
}

template <typename Value>
std::size_t rank_in(const std::vector<Value>& sorted, const Value& value) {
  return static_cast<std::size_t>(std::lower_bound(sorted.begin(), sorted.end(), value) -
                                  sorted.begin());
}

// Orders the payloads of each block for the fewest changes in total: where possible, a block begins
// with the payload that ended the one before.
std::vector<std::vector<double>> payload_orders(const std::vector<std::vector<double>>& blocks) {
  struct End {
    std::size_t changes = 0, before = 0, first = 0;
  };
  std::vector<std::vector<End>> ends;  // by block and by the payload that ends it
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const std::vector<double>& block = blocks[b];
    ends.emplace_back();
    for (std::size_t last = 0; last < block.size(); ++last) {
      End best{std::numeric_limits<std::size_t>::max(), 0, 0};
      for (std::size_t first = 0; first < block.size(); ++first) {
        if (first == last && block.size() > 1) continue;
        const std::size_t earlier = b == 0 ? 1 : blocks[b - 1].size();
        for (std::size_t before = 0; before < earlier; ++before) {
          const std::size_t changes = b == 0 ? 0
                                             : ends[b - 1][before].changes +
                                                   (blocks[b - 1][before] == block[first] ? 0 : 1);
          if (changes < best.changes) best = {changes, before, first};
        }
      }
      ends.back().push_back(best);
    }
  }
  std::vector<std::vector<double>> orders(blocks.size());
  std::size_t last = 0;
  for (std::size_t b = blocks.size(); b-- > 0;) {
    const std::vector<double>& block = blocks[b];
    if (b + 1 == blocks.size()) {
      for (std::size_t k = 0; k < block.size(); ++k) {
        if (ends[b][k].changes <= ends[b][last].changes) last = k;
      }
    }
    const End& end = ends[b][last];
    orders[b].push_back(block[end.first]);
    for (std::size_t k = 0; k < block.size(); ++k) {
      if (k != end.first && k != last) orders[b].push_back(block[k]);
    }
    if (last != end.first) orders[b].push_back(block[last]);
    last = end.before;
  }
  return orders;
}

}  // namespace

std::vector<std::vector<bool>> sessions(const Menu& menu) {
  const std::size_t rows = row_count(menu);
  const std::vector<Temperatures> temperature = temperatures_of(menu, rows);
  const std::vector<double> time = column_or_none(menu, "time", rows);
  const std::set<Temperatures> different(temperature.begin(), temperature.end());
  const std::set<double> moments(time.begin(), time.end());
  if (different.size() < 2 || moments.size() < 2) return {std::vector<bool>(rows, true)};
  const std::vector<Temperatures> levels(different.begin(), different.end());
  const std::vector<double> times(moments.begin(), moments.end());
  const std::size_t highest = levels.size() - 1;
  const double all = binomial(highest + times.size(), times.size());
  const double tried = std::min(all, kMostSessions);
  std::vector<std::vector<bool>> result;
  for (double k = 0.0; k < tried; ++k) {
    const std::vector<std::size_t> rising =
        course(highest, times.size(), std::floor(k * all / tried));
    if (rising.front() == rising.back()) continue;
    for (const bool falls : {false, true}) {
      std::vector<bool>& mask = result.emplace_back(rows);
      for (std::size_t row = 0; row < rows; ++row) {
        const std::size_t level = rising[rank_in(times, time[row])];
        mask[row] = temperature[row] == levels[falls ? highest - level : level];
      }
    }
  }
  return result;
}

std::vector<std::size_t> run_order(const Menu& menu, const Robot& robot,
                                   const std::vector<std::size_t>& rows) {
  const std::size_t count = row_count(menu);
  const std::vector<Temperatures> temperature = temperatures_of(menu, count);
  const std::vector<double> time = column_or_none(menu, "time", count);
  const std::vector<double> payload = column_or_none(menu, "payload", count);
  // In a session each temperature ends before the next begins, so its times determine its turn.
  std::map<Temperatures, std::pair<double, double>> span;
  for (const std::size_t row : rows) {
    const auto [at, fresh] = span.try_emplace(temperature[row], time[row], time[row]);
    if (fresh) continue;
    at->second.first = std::min(at->second.first, time[row]);
    at->second.second = std::max(at->second.second, time[row]);
  }
  using Turn = std::tuple<std::pair<double, double>, Temperatures, double>;
  std::map<Turn, std::map<double, std::vector<std::size_t>>> turns;
  for (const std::size_t row : rows) {
    turns[{span.at(temperature[row]), temperature[row], time[row]}][payload[row]].push_back(row);
  }
  std::vector<std::vector<double>> blocks;
  for (const auto& [turn, by_payload] : turns) {
    blocks.emplace_back();
    for (const auto& [mass, group] : by_payload) blocks.back().push_back(mass);
  }
  // Joints move simultaneously: the longest motion decides.
  const auto way = [&](std::size_t a, std::size_t b) {
    double longest = 0.0;
    for (int k = 1; k <= robot.joint_count(); ++k) {
      const std::vector<double>& q = menu.columns.at("q" + std::to_string(k));
      longest = std::max(longest, std::abs(q[a] - q[b]));
    }
    return longest;
  };
  std::vector<std::size_t> order;
  auto turn = turns.begin();
  for (const std::vector<double>& masses : payload_orders(blocks)) {
    for (const double mass : masses) {
      std::vector<std::size_t>& left = turn->second.at(mass);
      while (!left.empty()) {
        const auto next =
            order.empty()
                ? left.begin()
                : std::min_element(left.begin(), left.end(), [&](std::size_t x, std::size_t y) {
                    return way(order.back(), x) < way(order.back(), y);
                  });
        order.push_back(*next);
        left.erase(next);
      }
    }
    ++turn;
  }
  return order;
}

}  // namespace armtrue
