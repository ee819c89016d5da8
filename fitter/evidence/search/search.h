// Search over sets of blocks: which columns explain the residual of a linearised model, and with
// what probability.
//
// Spike-and-slab regression with a Gaussian prior on every coefficient and a grid of prior sizes
// (George and McCulloch 1997, Statistica Sinica 7, 339; Liang et al. 2008, JASA 103, 410). Linear
// algebra over a Gram matrix; nothing here depends on robot arms.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace armtrue {

/// An effect that carries a load acts against it: the cosine between its terms, with coefficients
/// c, and the load over all rows is cᵀ along / sqrt(cᵀ square c).
struct Carrying {
  Eigen::VectorXd along;   ///< Bᵀ load / |load|, B the terms per unit of each coefficient
  Eigen::MatrixXd square;  ///< BᵀB
  double yields = 0.0;     ///< norm of the deflection of the same coordinate by the load itself;
                           ///< 0: not known
};

/// A sign that physics prescribes: along · (coefficients) ≥ 0, or the opposite with probability
/// `doubt`.
struct SignRule {
  Eigen::VectorXd along;
  double doubt = 0.0;
};

/// One prior of a block: the factors of its columns are scale · spread · u, with u standard normal
/// and one scale of several.
struct PriorShape {
  Eigen::MatrixXd spread;     ///< columns × directions
  Eigen::MatrixXd units;      ///< coefficients in their units × directions: scale · units · u
  int form = 0;               ///< index of the block's form
  std::vector<double> scale;  ///< sizes tried
  std::vector<double> log_prior;  ///< of each size, given that the block is present
  std::vector<SignRule> signs;
  std::vector<Carrying> carries;  ///< none or one
};

/// Columns that enter or leave the model together.
struct SearchBlock {
  Eigen::Index first = 0, width = 0;  ///< columns in the Gram matrix
  std::vector<PriorShape> shapes;
  double log_odds = 0.0;     ///< prior odds of presence
  bool present = false;      ///< in the model at which the search begins
  bool replaceable = false;  ///< present, and added by a search: a replacement is no missing effect
  bool counts = true;        ///< if present, but not at the start, an effect is missing
  bool costly = false;       ///< a table of many directions: visited once in several sweeps
};

/// Normal equations with the columns of the base, which is always in the model, projected out, in
/// units in which the noise is about one.
struct SearchProblem {
  Eigen::MatrixXd gram;        ///< ZᵀZ, full
  Eigen::VectorXd gradient;    ///< Zᵀy
  Eigen::VectorXd whole;       ///< squares of the columns before anything was projected out
  double squares = 0.0;        ///< yᵀy
  double freedom = 1.0;        ///< equations less what was projected out
  double prior_freedom = 0.0;  ///< of the prior of the noise's variance, whose expected value is 1
  std::vector<SearchBlock> blocks;
};

struct SearchOptions {
  int burn_in = 12;
  int sweeps = 60;
  std::uint64_t seed = 1;
};

struct SearchResult {
  std::vector<double> inclusion;  ///< by block: probability of being present
  double nothing_missing = 1.0;  ///< probability that no more blocks are present than at the start:
                                 ///< one may replace a replaceable one
  std::vector<bool> likeliest;   ///< by block: present in the likeliest set seen
  double log_evidence = 0.0;     ///< of that set, up to a constant of the data
  std::vector<int> shape;        ///< by block: the prior shape that it has or would have
  std::vector<Eigen::VectorXd> coefficient,
      sigma;  ///< by block, present in `likeliest` or added to it alone
  std::vector<double>
      gain;  ///< by block: fall of Σ r² when added to (removed from) the likeliest set
  std::vector<double>
      log_bayes;         ///< by block: log evidence with it less that without, in the likeliest set
  double squares = 0.0;  ///< Σ r² that the likeliest set leaves
  double start_squares = 0.0;    ///< Σ r² of the start set, at which the search begins
  std::vector<int> alone_shape;  ///< by block: the best prior shape beside the start set alone
  std::vector<double> alone_gain, alone_log_bayes;  ///< by block: beside the start set alone
  /// (a, b): share of what b explains beside the start set that it still explains beside a. 1
  /// unless both are absent from that set and have a Bayes factor above 1, and b explains at least
  /// about as much as a or a is a structure.
  Eigen::MatrixXd beyond;
  std::vector<double>
      separability;  ///< by block: least share of a column that base and start set do not explain
  /// Prior factors c = W u of the likeliest set, one for each block of it (for later steps).
  std::vector<std::pair<std::size_t, Eigen::MatrixXd>> factors;
};

/// Gibbs sampling over presence and size of every block, with exchanges of one block for another;
/// begins at the set that a greedy search reaches from the present one. Inclusion probabilities are
/// averages of conditional probabilities (Rao–Blackwell).
SearchResult search_blocks(const SearchProblem& problem, const SearchOptions& options);

}  // namespace armtrue
