#include "fitter/evidence/search/search.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <utility>

#include "fitter/common/observer.h"
#include "fitter/common/parallel.h"
#include "fitter/evidence/search/sampler.h"

namespace armtrue {
namespace {

// Costly blocks are visited in one of this many sweeps. Those that are present are all visited in
// the same sweep, before the other blocks, because after each change of one all other columns are
// worked out again. A fixed order of visits does not change the stationary distribution.
constexpr int kCostlyEvery = 8;
// A block whose presence or absence was less probable than this at its last visit is visited as
// rarely as costly ones.
constexpr double kImprobable = 1e-3;
// A block that enters with a probability below this counts as strange (sweep()).
constexpr double kStrange = 0.02;
// Exchanges happen in one of this many sweeps, because each evaluates every block.
constexpr int kExchangeEvery = 4;
// Between passes over all blocks, climb() evaluates only those whose best change had log odds above
// this.
constexpr double kPromising = -4.0;
// An alternative explanation is kept if its log odds against the likeliest set are above this.
constexpr double kWorthReading = -6.0;
constexpr double kLeastRise = 1e-6;
// A table is compared with formulas only if its prior has at most this many directions: it is then
// smooth enough.
constexpr Eigen::Index kSmoothTable = 40;
// Sizes of blocks that depend on one another settle in two or three passes.
constexpr int kSizingPasses = 5;
// Independent walks of the sampler from the set that the greedy search reached.
constexpr std::size_t kWalks = 4;

}  // namespace

void Sampler::set(std::size_t b, const Choice& c) {
  if (state_[b] == c) return;
  if (state_[b].is_present()) eliminated_.remove(b);
  if (c.is_present()) eliminated_.add(b, block(b).first, factor(b, c));
  state_[b] = c;
}

void Sampler::go_to(const std::vector<Choice>& wanted) {
  for (std::size_t b = 0; b < wanted.size(); ++b) {
    if (state_[b] != wanted[b]) set(b, {});
  }
  for (std::size_t b = 0; b < wanted.size(); ++b) set(b, wanted[b]);
}

// Eliminates costly blocks first. The others, which enter and leave often, come last, so that a
// change recomputes few later columns.
void Sampler::line_up() {
  const std::vector<Choice> wanted = state_;
  for (std::size_t b = 0; b < wanted.size(); ++b) {
    if (!block(b).costly) set(b, {});
  }
  go_to(wanted);
}

Choice Sampler::draw(const Conditional& c) {
  const double total = log_sum(c.log_weight);
  double left = std::uniform_real_distribution<double>(0.0, 1.0)(generator_);
  for (std::size_t i = 0; i < c.choices.size(); ++i) {
    left -= std::exp(c.log_weight[i] - total);
    if (left <= 0.0) return c.choices[i];
  }
  return c.choices.front();
}

double Sampler::log_posterior() const {
  double value = fit_term(problem_, eliminated_.squares()) - 0.5 * eliminated_.log_determinant();
  for (std::size_t b = 0; b < state_.size(); ++b) {
    if (!state_[b].is_present()) continue;
    const PriorShape& shape = block(b).shapes[static_cast<std::size_t>(state_[b].shape)];
    value += block(b).log_odds + shape.log_prior[static_cast<std::size_t>(state_[b].scale)];
  }
  return value;
}

void Sampler::remember() {
  const double value = log_posterior();
  if (value <= best_posterior_) return;
  best_posterior_ = value;
  best_ = state_;
}

std::vector<Conditional> Sampler::conditionals(const std::vector<std::size_t>& blocks) const {
  std::vector<Conditional> result(blocks.size());
  in_parallel(blocks.size(), [&](std::size_t i) { result[i] = conditional(blocks[i]); });
  return result;
}

// The change of one block of `looked_at` that raises the posterior most; returns the rise. Blocks
// without a promising change are removed from `looked_at`.
double Sampler::best_change(std::vector<std::size_t>& looked_at, std::size_t& at,
                            Choice& to) const {
  double most = kLeastRise;
  std::vector<std::size_t> promising;
  const std::vector<Conditional> all = conditionals(looked_at);
  for (std::size_t seen = 0; seen < looked_at.size(); ++seen) {
    const std::size_t b = looked_at[seen];
    const Conditional& c = all[seen];
    const auto now = static_cast<std::size_t>(
        std::find(c.choices.begin(), c.choices.end(), state_[b]) - c.choices.begin());
    double rise = -std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < c.choices.size(); ++i) {
      if (i == now || c.log_weight[i] - c.log_weight[now] <= rise) continue;
      rise = c.log_weight[i] - c.log_weight[now];
      if (rise <= most) continue;
      most = rise;
      at = b;
      to = c.choices[i];
    }
    if (rise > kPromising) promising.push_back(b);
  }
  looked_at = std::move(promising);
  return most;
}

// Makes the single change of an allowed block that raises the posterior most, until none does. The
// sign terms depend on the other blocks, so that changes can form a cycle: a state that was reached
// before ends the ascent.
void Sampler::climb(const std::vector<std::size_t>& allowed) {
  std::vector<std::size_t> looked_at = allowed;
  std::set<std::vector<Choice>> been{state_};
  bool whole = true;
  for (;;) {
    throw_if_cancelled();
    std::size_t at = 0;
    Choice to;
    const double rise = best_change(looked_at, at, to);
    if (rise <= kLeastRise) {
      if (whole) break;
      looked_at = allowed;
      whole = true;
      continue;
    }
    set(at, to);
    if (!been.insert(state_).second) break;
    whole = false;
  }
  remember();
}

bool Sampler::has_stranger() const {
  for (std::size_t b = 0; b < state_.size(); ++b) {
    if (strange_[b] && state_[b].is_present()) return true;
  }
  return false;
}

void Sampler::sweep(int number, bool count) {
  std::vector<std::size_t> order(state_.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[generator_() % i]);
  const auto is_costly_and_present = [&](std::size_t b) {
    return block(b).costly && state_[b].is_present();
  };
  std::stable_partition(order.begin(), order.end(), is_costly_and_present);
  for (const std::size_t b : order) {
    const bool settled =
        state_[b].is_present() ? last_[b] > 1.0 - kImprobable : last_[b] < kImprobable;
    // A block that entered against the odds may keep a table from its former state, or be kept in
    // by changes since then: all blocks are visited until it has left.
    const bool seldom = (block(b).costly || settled) && !has_stranger();
    if (count) visits_[b] += 1.0;
    const int turn = is_costly_and_present(b) ? number : number + static_cast<int>(b);
    if (seldom && turn % kCostlyEvery != 0) {
      if (count && state_[b].is_present()) inclusion_[b] += 1.0;
      continue;
    }
    const Conditional c = conditional(b);
    last_[b] = c.probability();
    if (count) inclusion_[b] += c.probability();
    const Choice drawn = draw(c);
    if (!state_[b].is_present()) strange_[b] = c.probability() < kStrange;
    set(b, drawn);
  }
  if (number % kExchangeEvery == 0) exchange();
  for (const Reading& reading : readings_) read_otherwise(reading);
  remember();
  if (!count) return;
  counted_ += 1.0;
  int more = 0;
  for (std::size_t b = 0; b < state_.size(); ++b) {
    if (!block(b).present && block(b).counts && state_[b].is_present()) ++more;
    if (block(b).replaceable && !state_[b].is_present()) --more;
  }
  nothing_ += more <= 0 ? 1.0 : 0.0;
}

// Removes one present block and draws its replacement from the absent ones, itself and none
// included. Costly blocks do not take part.
void Sampler::exchange() {
  std::vector<std::size_t> present;
  for (std::size_t b = 0; b < state_.size(); ++b) {
    if (state_[b].is_present() && !block(b).costly) present.push_back(b);
  }
  if (present.empty()) return;
  const std::size_t gone = present[generator_() % present.size()];
  set(gone, {});
  std::vector<double> weight{fit_term(problem_, eliminated_.squares())};
  std::vector<std::pair<std::size_t, Choice>> stands{{gone, Choice{}}};
  std::vector<std::size_t> absent;
  for (std::size_t b = 0; b < state_.size(); ++b) {
    if (!state_[b].is_present() && !block(b).costly) absent.push_back(b);
  }
  const std::vector<Conditional> all = conditionals(absent);
  for (std::size_t a = 0; a < absent.size(); ++a) {
    const std::size_t b = absent[a];
    const Conditional& c = all[a];
    for (std::size_t i = 1; i < c.choices.size(); ++i) {
      weight.push_back(c.log_weight[i]);
      stands.emplace_back(b, c.choices[i]);
    }
  }
  const double total = log_sum(weight);
  double left = std::uniform_real_distribution<double>(0.0, 1.0)(generator_);
  for (std::size_t i = 0; i < weight.size(); ++i) {
    left -= std::exp(weight[i] - total);
    if (left > 0.0) continue;
    set(stands[i].first, stands[i].second);
    return;
  }
}

// Log evidence of the set with one side of a reading present, over all sizes of the side's members:
// the evidence at their likely sizes divided by the conditional probabilities of these sizes (Chib
// 1995, JASA 90, 1313, with each conditional at the likely sizes of the others). The members are
// set, one after the other, to `sizes`, or drawn if that is empty: the log ratio of posterior to
// proposal probability of the sizes set is the same sum.
double Sampler::weigh(const Side& side, std::vector<Choice>& sizes) {
  for (std::size_t i = 0; i < side.members.size(); ++i) set(side.members[i], side.likely[i]);
  double sum = log_posterior();
  for (std::size_t i = 0; i < side.members.size(); ++i) {
    Conditional there = conditional(side.members[i]);
    there.choices.erase(there.choices.begin());
    there.log_weight.erase(there.log_weight.begin());
    const auto likely = std::ranges::find(there.choices, side.likely[i]) - there.choices.begin();
    const auto at = static_cast<std::size_t>(likely);
    sum += log_sum(there.log_weight) - there.log_weight[at] + there.log_physics[1 + at];
    if (i == sizes.size()) sizes.push_back(draw(there));
    set(side.members[i], sizes[i]);
  }
  return sum;
}

void Sampler::take_out(const Side& side) {
  for (const std::size_t b : side.members) set(b, {});
}

// Finds alternative explanations: one block may replace another, or two may replace one. Each
// member of the likeliest set is removed in turn, and the greedy search continues without it.
void Sampler::find_readings() {
  const std::vector<Choice> home = best_;
  const double home_posterior = best_posterior_;
  std::vector<Choice> better = home;
  double gain = 0.0;
  for (std::size_t gone = 0; gone < home.size(); ++gone) {
    if (!home[gone].is_present() || !block(gone).counts) continue;
    if (block(gone).costly && factor(gone, home[gone]).cols() > kSmoothTable) continue;
    std::vector<Choice> without_it = home;
    without_it[gone] = {};
    go_to(without_it);
    std::vector<std::size_t> allowed;
    for (std::size_t b = 0; b < home.size(); ++b) {
      if (b != gone && !block(b).costly && block(b).counts) allowed.push_back(b);
    }
    // Keeps only blocks that might replace it in `allowed`.
    std::size_t at = 0;
    Choice to;
    if (best_change(allowed, at, to) <= kLeastRise) continue;
    set(at, to);
    climb(allowed);
    // The two are compared by their evidence over all sizes, sign rules and carried loads included.
    best_ = home;
    best_posterior_ = home_posterior;
    const std::vector<Choice> otherwise = state_;
    Reading reading;
    for (std::size_t b = 0; b < home.size(); ++b) {
      if (home[b] == otherwise[b]) continue;
      if (home[b].is_present()) reading.one.add(b, home[b]);
      if (otherwise[b].is_present()) reading.other.add(b, otherwise[b]);
    }
    double odds = weigh(reading.other, reading.other.likely);
    take_out(reading.other);
    odds -= weigh(reading.one, reading.one.likely);
    if (odds > gain) better = otherwise;
    gain = std::max(gain, odds);
    if (odds > kWorthReading) readings_.push_back(std::move(reading));
  }
  go_to(better);
  best_ = better;
  best_posterior_ = log_posterior();
}

bool Sampler::stands(const Side& side, const Side& other) const {
  const auto is_in = [&](std::size_t b) { return state_[b].is_present(); };
  return std::ranges::all_of(side.members, is_in) &&
         std::ranges::none_of(other.members, [&](std::size_t b) {
           return is_in(b) && std::ranges::find(side.members, b) == side.members.end();
         });
}

// A Metropolis–Hastings step from one side of a reading to the other, with sizes drawn on entry:
// each side counts with its evidence over all sizes.
void Sampler::read_otherwise(const Reading& reading) {
  const bool at_one = stands(reading.one, reading.other);
  if (!at_one && !stands(reading.other, reading.one)) return;
  const Side& from = at_one ? reading.one : reading.other;
  const Side& to = at_one ? reading.other : reading.one;
  std::vector<Choice> sizes, drawn;
  for (const std::size_t b : from.members) sizes.push_back(state_[b]);
  const double here = weigh(from, sizes);
  take_out(from);
  const double there = weigh(to, drawn);
  if (std::log(std::uniform_real_distribution<double>(0.0, 1.0)(generator_)) < there - here) return;
  take_out(to);
  for (std::size_t i = 0; i < from.members.size(); ++i) set(from.members[i], sizes[i]);
}

// Gives the blocks at which the search begins their likeliest sizes, one after the other. This is
// repeated while a size changes, since the first ones were chosen without the others.
void Sampler::size_present() {
  for (int pass = 0; pass < kSizingPasses; ++pass) {
    const std::vector<Choice> before = state_;
    for (std::size_t b = 0; b < state_.size(); ++b) {
      if (!block(b).present) continue;
      const Conditional c = conditional(b);
      const auto best = std::max_element(c.log_weight.begin() + 1, c.log_weight.end());
      set(b, c.choices[static_cast<std::size_t>(best - c.log_weight.begin())]);
    }
    if (state_ == before) return;
  }
}

// Greedy search, then walks of the sampler: describes the best walk, with probabilities from all.
SearchResult Sampler::run() {
  const std::size_t count = state_.size();
  inclusion_.assign(count, 0.0);
  visits_.assign(count, 0.0);
  last_.assign(count, 1.0);
  strange_.assign(count, false);
  size_present();
  SearchResult result;
  describe_alone(result);
  // A table, or a smooth function, may replace several effects at once. So one search begins with
  // blocks of few coefficients and adds the others later, a second one allows all from the start,
  // and the better result is kept.
  const std::vector<Choice> start = state_;
  std::vector<std::size_t> few, effects, all;
  for (std::size_t b = 0; b < count; ++b) {
    all.push_back(b);
    if (block(b).counts) effects.push_back(b);
    if (block(b).counts && !block(b).costly) few.push_back(b);
  }
  climb(few);
  climb(effects);
  if (effects.size() < all.size()) climb(all);
  if (few.size() < all.size()) {
    go_to(start);
    climb(all);
    go_to(best_);
  }
  if (options_.sweeps > 0) {
    line_up();
    find_readings();
  }
  // One walk may stay near a local maximum of the posterior that another avoids. The averages of a
  // walk are weighted by the posterior of the best set that it found.
  std::vector<Sampler> walks(options_.sweeps > 0 ? kWalks : 1, *this);
  in_parallel(walks.size(), [&](std::size_t i) { walks[i].walk(options_.seed + i); });
  const auto best = std::ranges::max_element(walks, {}, &Sampler::best_posterior_);
  best->describe(result);
  result.inclusion.assign(count, 0.0);
  result.nothing_missing = 0.0;
  double weights = 0.0;
  for (const Sampler& walk : walks)
    weights += std::exp(walk.best_posterior_ - best->best_posterior_);
  for (const Sampler& walk : walks) {
    const double weight = std::exp(walk.best_posterior_ - best->best_posterior_) / weights;
    for (std::size_t b = 0; b < count; ++b) {
      result.inclusion[b] += weight * (walk.visits_[b] > 0.0 ? walk.inclusion_[b] / walk.visits_[b]
                                                             : (result.likeliest[b] ? 1.0 : 0.0));
    }
    result.nothing_missing += weight * (walk.counted_ > 0.0 ? walk.nothing_ / walk.counted_ : 1.0);
  }
  return result;
}

void Sampler::walk(std::uint64_t seed) {
  generator_.seed(seed);
  for (int i = 0; i < options_.burn_in + options_.sweeps; ++i) {
    throw_if_cancelled();
    sweep(i, i >= options_.burn_in);
  }
}

SearchResult search_blocks(const SearchProblem& problem, const SearchOptions& options) {
  return Sampler(problem, options).run();
}

}  // namespace armtrue
