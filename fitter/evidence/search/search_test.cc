#include "fitter/evidence/search/search.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace armtrue {
namespace {

// Blocks of random columns; y is noise plus the columns of some blocks.
struct Example {
  Eigen::MatrixXd columns;
  Eigen::VectorXd y;
  SearchProblem problem;
};

Eigen::MatrixXd normal(std::mt19937_64& generator, Eigen::Index rows, Eigen::Index columns) {
  std::normal_distribution<double> one;
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return one(generator); });
}

SearchBlock block(Eigen::Index first, Eigen::Index width, double size) {
  SearchBlock result;
  result.first = first;
  result.width = width;
  PriorShape shape;
  shape.spread = shape.units = Eigen::MatrixXd::Identity(width, width);
  shape.scale = {0.3 * size, size, 3.0 * size};
  shape.log_prior.assign(3, -std::log(3.0));
  result.shapes = {shape};
  result.log_odds = std::log(0.05);
  return result;
}

void set_products(Example& e) {
  e.problem.gram = e.columns.transpose() * e.columns;
  e.problem.gradient = e.columns.transpose() * e.y;
  e.problem.whole = e.problem.gram.diagonal();
  e.problem.squares = e.y.squaredNorm();
  e.problem.freedom = static_cast<double>(e.y.size());
}

Example example(std::uint64_t seed, const std::vector<double>& sizes, Eigen::Index rows = 120) {
  std::mt19937_64 generator(seed);
  Example e;
  const auto blocks = static_cast<Eigen::Index>(sizes.size());
  e.columns = normal(generator, rows, 2 * blocks);
  e.y = normal(generator, rows, 1);
  for (Eigen::Index b = 0; b < blocks; ++b) {
    const double size = sizes[static_cast<std::size_t>(b)];
    e.y += size * (e.columns.col(2 * b) - e.columns.col(2 * b + 1));
    e.problem.blocks.push_back(block(2 * b, 2, 1.0));
  }
  set_products(e);
  return e;
}

// log p(y | blocks present at given scales), noise integrated out, from the definition: y is
// Gaussian with covariance I + X W Wᵀ Xᵀ.
double log_evidence(const Example& e, const std::vector<std::pair<std::size_t, double>>& present) {
  const Eigen::Index n = e.y.size();
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Identity(n, n);
  for (const auto& [b, scale] : present) {
    const SearchBlock& own = e.problem.blocks[b];
    const Eigen::MatrixXd x = scale * e.columns.middleCols(own.first, own.width);
    covariance += x * x.transpose();
  }
  const Eigen::LLT<Eigen::MatrixXd> root(covariance);
  const double square = e.y.dot(root.solve(e.y));
  return -root.matrixLLT().diagonal().array().log().sum() -
         0.5 * (static_cast<double>(n) + e.problem.prior_freedom) *
             std::log(0.5 * (e.problem.prior_freedom + square));
}

// Inclusion probabilities, by enumeration of all sets and sizes.
std::vector<double> enumerated(const Example& e) {
  const std::size_t blocks = e.problem.blocks.size();
  std::vector<double> weight, scale{0.0};
  for (const double s : e.problem.blocks[0].shapes[0].scale) scale.push_back(s);
  std::vector<std::vector<std::size_t>> chosen;
  std::size_t sets = 1;
  for (std::size_t b = 0; b < blocks; ++b) sets *= scale.size();
  for (std::size_t s = 0; s < sets; ++s) {
    std::vector<std::pair<std::size_t, double>> present;
    std::vector<std::size_t> names;
    double prior = 0.0;
    std::size_t left = s;
    for (std::size_t b = 0; b < blocks; ++b, left /= scale.size()) {
      const std::size_t size = left % scale.size();
      if (size == 0) continue;
      present.emplace_back(b, scale[size]);
      names.push_back(b);
      prior += e.problem.blocks[b].log_odds + e.problem.blocks[b].shapes[0].log_prior[size - 1];
    }
    weight.push_back(log_evidence(e, present) + prior);
    chosen.push_back(names);
  }
  const double most = *std::max_element(weight.begin(), weight.end());
  std::vector<double> result(blocks, 0.0);
  double total = 0.0;
  for (std::size_t s = 0; s < sets; ++s) {
    total += std::exp(weight[s] - most);
    for (const std::size_t b : chosen[s]) result[b] += std::exp(weight[s] - most);
  }
  for (double& p : result) p /= total;
  return result;
}

// Two blocks together explain the same as a third alone, except for a small part that decides
// between them.
Example two_or_one(double towards_one) {
  Example e = example(11, {0.0, 0.0, 0.0});
  std::mt19937_64 generator(12);
  const Eigen::MatrixXd rest = normal(generator, e.y.size(), 2);
  e.columns.rightCols(2) = e.columns.leftCols(2) + e.columns.middleCols(2, 2) + 0.3 * rest;
  e.y += 2.0 * (e.columns.col(0) + e.columns.col(2)) + 2.0 * 0.3 * towards_one * rest.col(0);
  set_products(e);
  return e;
}

TEST(SearchBlocks, TwoBlocksOrOne_InclusionMatchesEnumeration) {
  int undecided = 0;
  for (double towards_one = 0.0; towards_one < 1.0; towards_one += 0.02) {
    const Example e = two_or_one(towards_one);
    const std::vector<double> exact = enumerated(e);
    if (exact[2] < 0.2 || exact[2] > 0.8) continue;
    ++undecided;
    const SearchResult found = search_blocks(e.problem, {20, 2000, 5});
    for (std::size_t b = 0; b < 3; ++b) EXPECT_NEAR(found.inclusion[b], exact[b], 0.06) << b;
  }
  EXPECT_GT(undecided, 0);
}

TEST(SearchBlocks, SizeOfABlock_IsChosenJointlyWithItsSet) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    // The first block alone explains nearly as much as the first two, but with coefficients 25
    // times those that it has with the second. The third, a table that the sampler rarely visits,
    // explains all alone.
    Example e = example(seed, {0.0, 0.0, 0.0}, 4000);
    auto first = e.columns.leftCols(2), second = e.columns.middleCols(2, 2);
    auto third = e.columns.rightCols(2);
    second = first + 0.5 * second;
    third = 0.04 * first + second + 0.003 * third;
    e.y += 5.0 * (0.04 * first.col(0) + second.col(0));
    set_products(e);
    for (SearchBlock& own : e.problem.blocks) own = block(own.first, 2, 0.6);
    e.problem.blocks[0].log_odds = e.problem.blocks[1].log_odds = -10.0;
    e.problem.blocks[2].costly = true;
    EXPECT_GT(search_blocks(e.problem, {}).inclusion[2], 0.9) << seed;
  }
}

TEST(SearchBlocks, InclusionProbabilities_MatchEnumerationOfAllSets) {
  const Example e = example(1, {0.5, 0.0, 0.21, 0.0});
  SearchOptions options;
  options.sweeps = 4000;
  const SearchResult result = search_blocks(e.problem, options);
  const std::vector<double> expected = enumerated(e);
  EXPECT_GT(expected[2], 0.02);  // the data leave this block undecided
  EXPECT_LT(expected[2], 0.98);
  for (std::size_t b = 0; b < expected.size(); ++b)
    EXPECT_NEAR(result.inclusion[b], expected[b], 0.03) << b;
}

TEST(SearchBlocks, IdenticalBlocks_ShareTheirProbability) {
  Example e = example(2, {0.6, 0.0, 0.0});
  e.columns.middleCols(2, 2) = e.columns.middleCols(0, 2);
  set_products(e);
  SearchOptions options;
  options.sweeps = 1000;
  const SearchResult result = search_blocks(e.problem, options);
  EXPECT_NEAR(result.inclusion[0], 0.5, 0.1);
  EXPECT_NEAR(result.inclusion[1], 0.5, 0.1);
  EXPECT_LT(result.nothing_missing, 0.01);
}

TEST(SearchBlocks, ReplacementOfAReplaceableBlock_IsNotMissing) {
  Example e = example(2, {0.6, 0.0, 0.7});
  e.columns.middleCols(2, 2) = e.columns.middleCols(0, 2);
  set_products(e);
  e.problem.blocks[0].present = e.problem.blocks[2].present = true;
  SearchOptions options;
  options.sweeps = 1000;
  EXPECT_NEAR(search_blocks(e.problem, options).nothing_missing, 0.5, 0.1);
  e.problem.blocks[0].replaceable = true;
  EXPECT_GT(search_blocks(e.problem, options).nothing_missing, 0.95);
  // Two blocks explain more than the single one that the model has now: one of them is missing.
  e.problem.blocks[2].present = false;
  EXPECT_LT(search_blocks(e.problem, options).nothing_missing, 0.01);
}

TEST(SearchBlocks, IdenticalBlocksAmongOthers_ShareInDefaultSweeps) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Example e = example(seed, {0.6, 0.0, 0.7, 0.8, 0.6, 0.9, 0.0, 0.0});
    e.columns.middleCols(2, 2) = e.columns.middleCols(0, 2);
    set_products(e);
    SearchOptions options;
    options.seed = seed;
    EXPECT_NEAR(search_blocks(e.problem, options).inclusion[0], 0.5, 0.25) << seed;
  }
}

TEST(SearchBlocks, Noise_HasNothingMissing) {
  double nothing = 0.0;
  for (std::uint64_t seed = 10; seed < 20; ++seed)
    nothing +=
        search_blocks(example(seed, {0.0, 0.0, 0.0, 0.0}).problem, {}).nothing_missing / 10.0;
  EXPECT_GT(nothing, 0.75);
}

TEST(SearchBlocks, BlockFarBetterKnownThanItsPrior_KeepsItsDigits) {
  // Removing such a block from the Gram matrix again loses all digits, so its conditional is
  // recomputed.
  Example e = example(3, {0.5, 0.0, 0.3});
  e.columns.leftCols(2) *= 1e5;
  e.y = e.columns.leftCols(2) * Eigen::Vector2d(1.0, -1.0) + 1e-3 * e.y;
  set_products(e);
  const SearchResult result = search_blocks(e.problem, {});
  ASSERT_TRUE(result.likeliest[0]);
  EXPECT_NEAR(result.coefficient[0][0], 1.0, 1e-4);
  EXPECT_LE(result.gain[0], e.problem.squares * (1.0 + 1e-9));
  EXPECT_GT(result.inclusion[0], 0.99);
}

TEST(SearchBlocks, WrongSign_ExcludesTheBlock) {
  Example e = example(4, {0.5, 0.0});
  e.problem.blocks[0].shapes[0].signs = {{Eigen::Vector2d(-1.0, 0.0)}};  // the truth is positive
  EXPECT_LT(search_blocks(e.problem, {}).inclusion[0], 0.1);             // its prior is 0.048
  e.problem.blocks[0].shapes[0].signs = {{Eigen::Vector2d(-1.0, 0.0), 0.05}};  // 5 % doubt
  EXPECT_GT(search_blocks(e.problem, {}).inclusion[0], 0.95);
  e.problem.blocks[0].shapes[0].signs = {{Eigen::Vector2d(1.0, 0.0)}};
  EXPECT_GT(search_blocks(e.problem, {}).inclusion[0], 0.95);
}

TEST(SearchBlocks, BalancerTorqueAlongItsLoad_LowersLogBayesByTen) {
  Example with = example(5, {0.3, 0.0}), along = with;
  const Eigen::MatrixXd square = Eigen::MatrixXd::Identity(2, 2);
  const Eigen::Vector2d truth(1.0, -1.0);
  with.problem.blocks[0].shapes[0].carries = {{-truth.normalized(), square, 0.0}};
  along.problem.blocks[0].shapes[0].carries = {{truth.normalized(), square, 0.0}};
  const double against = search_blocks(with.problem, {}).log_bayes[0];
  EXPECT_NEAR(against - search_blocks(along.problem, {}).log_bayes[0], 10.0, 0.5);
}

}  // namespace
}  // namespace armtrue
