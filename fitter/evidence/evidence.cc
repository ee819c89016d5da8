#include "fitter/evidence/evidence.h"

#include <cmath>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"
#include "fitter/evidence/contrasts.h"

namespace armtrue {
namespace {

// Rounds of a search followed by an estimate of the noise beside the set found. The noise starts
// from large values: a search that starts with small ones explains the noise by effects, and none
// is left to measure.
constexpr int kRounds = 3;
constexpr int kNoiseSteps = 12;
constexpr int kFewNoiseSteps = 4, kLastNoiseSteps = 2;  // of wide sets
constexpr Eigen::Index kWideSet = 200;                  // columns; steps of wider sets take long
constexpr Eigen::Index kWideProblem = 800;              // columns
// A smooth function has the form of an effect if it explains less than this share of its gain
// beside that effect. For a table the share is larger, because the table's smoothness leaves part
// of the function.
constexpr double kSameForm = 1e-2, kSameFormAsTable = 5e-2;

// Directions of columns below this share of the largest are rounding errors.
constexpr double kSmallestShare = 1e-7;

struct Projected {
  SearchProblem problem;
  double base_unknowns = 0.0;
};

// If masses are unknown, a spring has dozens of possible load terms, and the sizes of their
// coefficients are hardly known. Another block that takes over part of what these terms explain
// would gain from their smaller coefficients alone. So every other block is weighed only by what it
// explains beyond the columns of such springs.
void keep_what_unknown_loads_cannot_do(const std::vector<EvidenceBlock>& blocks, SearchProblem& p) {
  std::vector<Eigen::Index> loads, others;
  for (const EvidenceBlock& block : blocks) {
    std::vector<Eigen::Index>& own = block.unknown_load && block.present ? loads : others;
    for (Eigen::Index c = 0; c < block.search.width; ++c) own.push_back(block.search.first + c);
  }
  if (loads.empty()) return;
  const Eigen::MatrixXd own = p.gram(loads, loads);
  const Eigen::VectorXd unit = own.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const SymmetricEigen eigen = symmetric_eigen(unit.asDiagonal() * own * unit.asDiagonal());
  const Eigen::Index kept =
      (eigen.values.array() > kSmallestShare * eigen.values.maxCoeff()).count();
  const Eigen::MatrixXd directions =
      unit.asDiagonal() * eigen.vectors.rightCols(kept) *
      eigen.values.tail(kept).cwiseSqrt().cwiseInverse().asDiagonal();
  const Eigen::MatrixXd across = times(p.gram(others, loads), directions);
  p.gram(others, others) -= square_across(across);
  p.gram(others, loads) -= across * (directions.transpose() * own);
  p.gram(loads, others) = p.gram(others, loads).transpose().eval();
  p.gradient(others) -= across * (directions.transpose() * p.gradient(loads));
}

// Whitens all columns and projects out the base with its prior.
Projected project(const Fit& fit, const Linearization& l, const EvidenceModel& model,
                  const NoiseParts& noise) {
  const Eigen::Index base = model.base.cols(), width = model.width();
  Eigen::MatrixXd all(model.y.size(), base + width + 1);
  all.leftCols(base) = model.base;
  in_parallel(model.blocks.size(), [&](std::size_t b) {
    const EvidenceBlock& block = model.blocks[b];
    all.middleCols(base + block.search.first, block.search.width) = block.columns;
  });
  all.rightCols(1) = model.y;
  const PoseWhitening whitening(l, noise);
  whitening.apply(all);
  const Eigen::MatrixXd products = square(all);
  Projected result;
  const Eigen::MatrixXd information = products.topLeftCorner(base, base);
  const ScaledCholesky factor(information + model.base_precision);
  Eigen::MatrixXd cross = products.block(0, base, base, width + 1);
  cross.col(width) -= model.base_pull;
  const Eigen::MatrixXd half = factor.half_solve(cross);
  SearchProblem& p = result.problem;
  const Eigen::MatrixXd taken = square(half);
  p.gram = products.block(base, base, width, width) - taken.topLeftCorner(width, width);
  p.whole = products.diagonal().segment(base, width);
  p.gradient = products.block(base, base + width, width, 1) - taken.block(0, width, width, 1);
  p.squares = products(base + width, base + width) + model.base_pull_squares - taken(width, width);
  result.base_unknowns = factor.solve_matrix(information).trace();
  const IdleContrasts idle = idle_contrasts(l, fit.measurements().target, whitening, all);
  p.squares -= idle.squares;
  const double counted = counted_equations(l, noise);
  const double idle_freedom = idle.freedom * counted / static_cast<double>(l.equations());
  p.freedom = std::max(1.0, counted - result.base_unknowns - idle_freedom);
  p.prior_freedom = 1.0;
  for (const EvidenceBlock& block : model.blocks) p.blocks.push_back(block.search);
  keep_what_unknown_loads_cannot_do(model.blocks, p);
  return result;
}

// Base and the likeliest set as one matrix of columns with the precision of their prior.
struct Found {
  Eigen::MatrixXd columns, precision;
};

Found found_columns(const EvidenceModel& model, const SearchResult& search) {
  Eigen::Index width = model.base.cols();
  for (const auto& [b, w] : search.factors) width += w.cols();
  Found found{Eigen::MatrixXd(model.y.size(), width), Eigen::MatrixXd::Identity(width, width)};
  const Eigen::Index base = model.base.cols();
  found.columns.leftCols(base) = model.base;
  found.precision.topLeftCorner(base, base) = model.base_precision;
  Eigen::Index at = base;
  for (const auto& [b, w] : search.factors) {
    found.columns.middleCols(at, w.cols()) = model.blocks[b].columns * w;
    at += w.cols();
  }
  return found;
}

// True if block `b` is a structure of the same form as some effect: beside that effect it explains
// next to nothing, and must not compete with it, unless it is a cause of its own. A table counts
// only while it is not in the likeliest set itself: if it is, a structure there explains something
// else.
bool is_named_structure(const std::vector<EvidenceBlock>& blocks, const SearchResult& search,
                        std::size_t b) {
  if (!blocks[b].structure || blocks[b].is_cause) return false;
  for (std::size_t a = 0; a < blocks.size(); ++a) {
    const bool table = blocks[a].search.costly;
    if (blocks[a].structure || (table && search.likeliest[a])) continue;
    if (search.beyond(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)) <
        (table ? kSameFormAsTable : kSameForm))
      return true;
  }
  return false;
}

void drop_named_structure(std::vector<EvidenceBlock>& blocks, const SearchResult& search) {
  std::vector<bool> named;
  for (std::size_t b = 0; b < blocks.size(); ++b)
    named.push_back(is_named_structure(blocks, search, b));
  std::vector<EvidenceBlock> kept;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (!named[b]) kept.push_back(std::move(blocks[b]));
  }
  blocks = std::move(kept);
}

// True if the likeliest set contains a structure in place of the effect whose form it has.
bool holds_named_structure(const std::vector<EvidenceBlock>& blocks, const SearchResult& search) {
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (search.likeliest[b] && is_named_structure(blocks, search, b)) return true;
  }
  return false;
}

}  // namespace

EvidenceSummary weigh_evidence(Fit& fit, const Linearization& l, std::vector<Block> catalogue,
                               std::vector<EvidenceBlock> extra, const EvidenceOptions& options) {
  std::vector<EvidenceBlock> blocks = evidence_blocks(fit, l, std::move(catalogue));
  for (EvidenceBlock& block : blocks)
    block.believed = block.present && !options.searched.contains(block.label);
  std::move(extra.begin(), extra.end(), std::back_inserter(blocks));
  EvidenceModel model = make_evidence_model(fit, l, std::move(blocks));

  EvidenceSummary evidence;
  evidence.noise = broad_noise(l, l.residual);
  int rounds = model.width() > kWideProblem ? kRounds - 1 : kRounds;
  bool repeated = false;
  for (int round = 0; round < rounds; ++round) {
    bool last = round + 1 == rounds;
    const Projected projected = project(fit, l, model, evidence.noise);
    SearchOptions search;
    // Wide problems are sampled for a shorter time.
    search.sweeps = last ? (model.width() > kWideProblem ? options.sweeps / 3 : options.sweeps) : 0;
    if (!last) search.burn_in = 0;
    evidence.search = search_blocks(projected.problem, search);
    // One more round if the noise estimated by now favours another form than the initial noise did,
    // or if a smooth function has displaced the table of the same form.
    if (last && !repeated &&
        (wants_finer_forms(model.blocks, evidence.search) ||
         holds_named_structure(model.blocks, evidence.search))) {
      repeated = true;
      last = false;
      ++rounds;
    }
    const Found found = found_columns(model, evidence.search);
    const bool wide = found.columns.cols() > kWideSet;
    const int steps = !wide ? kNoiseSteps : last ? kLastNoiseSteps : kFewNoiseSteps;
    evidence.noise =
        estimate_noise(l, found.columns, found.precision, model.y, evidence.noise, {steps, last});
    if (!last) {
      refine_forms(fit, model.blocks, evidence.search);
      drop_named_structure(model.blocks, evidence.search);
      model = make_evidence_model(fit, l, std::move(model.blocks));
      continue;
    }
    const PoseWhitening whitening(l, evidence.noise);
    Eigen::MatrixXd white = found.columns;
    whitening.apply(white);
    const Eigen::MatrixXd information = square(white);
    const ScaledCholesky factor(information + found.precision);
    evidence.freedom = std::max(
        1.0, counted_equations(l, evidence.noise) - factor.solve_matrix(information).trace());
  }
  evidence.blocks = std::move(model.blocks);
  return evidence;
}

}  // namespace armtrue
