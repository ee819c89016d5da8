// One search over sets of blocks: which columns explain what a linearised model leaves, and how
// sure that is.
//
// Spike-and-slab regression with a Gaussian prior on every coefficient and a grid of prior sizes
// (George and McCulloch 1997, Statistica Sinica 7, 339; Liang et al. 2008, JASA 103, 410). Nothing
// here knows of arms: it is linear algebra over a Gram matrix.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace armtrue {

/// What an effect that carries a load gives runs against that load: its cosine with the load over
/// the campaign is cᵀ along / sqrt(cᵀ square c).
struct Carrying {
  Eigen::VectorXd along;   ///< Bᵀ load / |load|, B what a unit of each coefficient gives
  Eigen::MatrixXd square;  ///< BᵀB
  double yields = 0.0;  ///< root of the squares by which the load itself bends the same coordinate;
                        ///< 0: not known
};

/// What physics says of a sign: along · (coefficients) ≥ 0, or the other way with probability
/// `doubt`.
struct SignRule {
  Eigen::VectorXd along;
  double doubt = 0.0;
};

/// One prior on a block: its columns' factors are scale · spread · u, u standard normal, one scale
/// of several.
struct PriorShape {
  Eigen::MatrixXd spread;  ///< columns × directions
  Eigen::MatrixXd units;   ///< coefficients as people know them × directions: scale · units · u
  int form = 0;            ///< which form of the block it is
  std::vector<double> scale;      ///< sizes tried
  std::vector<double> log_prior;  ///< of each size, given that the block is present
  std::vector<SignRule> signs;
  std::vector<Carrying> carries;  ///< none or one
};

/// Columns that enter or leave the model together.
struct SearchBlock {
  Eigen::Index first = 0, width = 0;  ///< columns in the Gram matrix
  std::vector<PriorShape> shapes;
  double log_odds = 0.0;  ///< prior odds of presence
  bool present = false;   ///< stands in the model that the search begins at
  bool replaceable =
      false;            ///< so does one that a search put in: what takes its place is not missing
  bool counts = true;   ///< something is missing where this is present beyond the start
  bool costly = false;  ///< a table of many directions: visited once in several sweeps
};

/// Normal equations with the columns of what is always in the model projected out, in units in
/// which the noise is about one.
struct SearchProblem {
  Eigen::MatrixXd gram;        ///< ZᵀZ, full
  Eigen::VectorXd gradient;    ///< Zᵀy
  Eigen::VectorXd whole;       ///< squares of the columns before anything was projected out
  double squares = 0.0;        ///< yᵀy
  double freedom = 1.0;        ///< equations less what was projected out
  double prior_freedom = 0.0;  ///< of the noise's variance, whose expected value is 1
  std::vector<SearchBlock> blocks;
};

struct SearchOptions {
  int burn_in = 12;
  int sweeps = 60;
  std::uint64_t seed = 1;
};

struct SearchResult {
  std::vector<double> inclusion;  ///< by block: probability of being present
  double nothing_missing = 1.0;  ///< probability that no more blocks are present than were: one may
                                 ///< stand in a replaceable one's place
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
  double start_squares = 0.0;    ///< Σ r² that the set leaves at which the search began
  std::vector<int> alone_shape;  ///< by block: the prior shape that does best beside that set alone
  std::vector<double> alone_gain, alone_log_bayes;  ///< by block: beside that set alone
  /// (a, b): share of what b explains alone beside that set that it still explains beside a; only
  /// where both pay, and b explains about as much or a names no effect, else 1.
  Eigen::MatrixXd beyond;
  std::vector<double>
      separability;  ///< by block: least share of a column that survives the projection, beside it
  /// Prior factors c = W u of the likeliest set, one for each block of it (for what comes after the
  /// search).
  std::vector<std::pair<std::size_t, Eigen::MatrixXd>> factors;
};

/// Gibbs sampling over presence and size of every block, with exchanges of one block for another;
/// begins at the set that a greedy search reaches from the present one. Inclusion probabilities are
/// averages of conditional probabilities (Rao–Blackwell).
SearchResult search_blocks(const SearchProblem& problem, const SearchOptions& options);

}  // namespace armtrue
