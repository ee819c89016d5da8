#include "fitter/evidence/prior_shapes.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "fitter/common/dense.h"

namespace armtrue {
namespace {

// Root mean square displacement of the tool that one coefficient's prior expects [m]. The smallest
// can just be measured, the largest is seen on heavy arms. An effect larger than all of them would
// be attributed to another effect, with a high probability.
const std::vector<double> kSizes{25e-6, 80e-6, 250e-6, 800e-6, 2500e-6};
// A physical bound is this many standard deviations of the prior.
constexpr double kBoundIsSigmas = 2.0;
// The magnitude on real arms (Parameter::usual) is this many standard deviations of the prior.
constexpr double kUsualIsSigmas = 1.0;
// Share of arms whose stated masses are those of another version, or lack gears and motors.
constexpr double kUnusual = 0.1;
// Probability that two coefficients that are equal by design (Parameter::alike) differ from their
// mean only by a share kAlikeToShare. With independent priors alone, equal coefficients would be a
// coincidence, and the evidence would favour any effect that explains the same with one
// coefficient.
constexpr double kAreAlike = 0.7;
constexpr double kAlikeToShare = 0.02;
// Correlation lengths of tables [rad or m].
const std::vector<double> kLengths{3.0, 1.2, 0.5, 0.2, 0.08};
// Directions of a prior below this share of its largest variance are left out.
constexpr double kSmallestDirection = 1e-4;
// Blocks with more columns than this are replaced by an orthonormal basis of their span.
constexpr Eigen::Index kWide = 16;
constexpr double kSpanned = 1e-11;

enum class Largest { kUsual, kPossible };

double largest_size(const Parameter& p, Largest largest) {
  double most = std::numeric_limits<double>::infinity();
  if (p.bound > 0.0) most = p.bound / kBoundIsSigmas;
  if (largest == Largest::kPossible) return most;
  if (p.usual > 0.0) most = std::min(most, p.usual * kUsualIsSigmas);
  if (p.prior_sigma > 0.0) most = std::min(most, p.prior_sigma);
  return most;
}

// Prior standard deviations of coefficients at one size, from the displacement by each and its
// bound.
Eigen::VectorXd sizes_of(const EvidenceForm& form, const Eigen::VectorXd& displacement, double size,
                         Largest largest = Largest::kUsual) {
  Eigen::VectorXd sigma(displacement.size());
  for (std::size_t c = 0; c < form.like.size(); ++c) {
    const double moves = displacement[static_cast<Eigen::Index>(form.like[c])];
    const Parameter& p = form.block.terms.parameters[form.like[c]];
    sigma[static_cast<Eigen::Index>(c)] =
        moves > 0.0 ? std::min(size / moves, largest_size(p, largest)) : 0.0;
  }
  return sigma;
}

// Sign rules of the coefficients whose sign physics prescribes.
std::vector<SignRule> signs_of(const EvidenceForm& form) {
  std::vector<SignRule> result;
  const auto width = static_cast<Eigen::Index>(form.block.terms.parameters.size());
  for (Eigen::Index c = 0; c < width; ++c) {
    const Parameter& p = form.block.terms.parameters[static_cast<std::size_t>(c)];
    if (p.sign != 0) result.push_back({p.sign * Eigen::VectorXd::Unit(width, c), p.sign_doubt});
  }
  return result;
}

// Prior of two nearly equal coefficients: the standard deviation of their mean is the smaller of
// theirs, and they differ from the mean by a small share of that.
Eigen::MatrixXd alike(const Eigen::VectorXd& sigma) {
  Eigen::MatrixXd units(2, 2);
  units << 1.0, kAlikeToShare, 1.0, -kAlikeToShare;
  return sigma.minCoeff() * units;
}

}  // namespace

void add_shapes(const EvidenceForm& form, const Eigen::VectorXd& displacement, double known_size,
                Eigen::Index first, Eigen::Index width, std::vector<PriorShape>& shapes) {
  const Eigen::Index own = displacement.size();
  const std::vector<Parameter>& parameters = form.block.terms.parameters;
  const std::vector<SignRule> signs = signs_of(form);
  // Adds the prior `units`, scaled by each of `scales`. Only the first `rules` sign rules are
  // applied: those of nearly equal coefficients are not independent.
  const auto add = [&](const Eigen::MatrixXd& units, const std::vector<double>& scales,
                       double log_prior, std::size_t rules) {
    PriorShape shape;
    shape.units = units;
    shape.spread = Eigen::MatrixXd::Zero(width, units.cols());
    shape.spread.middleRows(first, own) = units;
    shape.scale = scales;
    shape.log_prior.assign(scales.size(), log_prior);
    std::copy_n(signs.begin(), std::min(rules, signs.size()), std::back_inserter(shape.signs));
    shapes.push_back(std::move(shape));
  };
  const bool may_be_alike = own == 2 && std::ranges::all_of(parameters, &Parameter::alike);
  const auto add_sizes = [&](const Eigen::VectorXd& sigma, const std::vector<double>& scales,
                             double log_prior) {
    const double alike_share = may_be_alike && sigma.minCoeff() > 0.0 ? kAreAlike : 0.0;
    add(sigma.asDiagonal(), scales, log_prior + std::log1p(-alike_share), signs.size());
    if (alike_share > 0.0) add(alike(sigma), scales, log_prior + std::log(alike_share), 1);
  };
  std::vector<double> sizes = kSizes;
  if (known_size > sizes.back()) sizes.push_back(known_size);
  std::vector<double> free_sizes;
  Eigen::VectorXd last;
  std::vector<Eigen::VectorXd> bounded;
  for (const double size : sizes) {
    const Eigen::VectorXd sigma = sizes_of(form, displacement, size);
    const bool is_free =
        (sigma - size / kSizes.front() * sizes_of(form, displacement, kSizes.front()))
            .cwiseAbs()
            .maxCoeff() <= 1e-12 * sigma.cwiseAbs().maxCoeff();
    if (is_free) {
      free_sizes.push_back(size);
    } else if (last.size() == 0 || (sigma - last).cwiseAbs().maxCoeff() > 0.05 * sigma.maxCoeff()) {
      bounded.push_back(sigma);
    }
    last = sigma;
  }
  const double each =
      form.log_prior - std::log(static_cast<double>(free_sizes.size() + bounded.size()));
  for (double& size : free_sizes) size /= kSizes.front();
  if (!free_sizes.empty())
    add_sizes(sizes_of(form, displacement, kSizes.front()), free_sizes, each);
  for (const Eigen::VectorXd& sigma : bounded) add_sizes(sigma, {1.0}, each);
  if (std::ranges::none_of(parameters, &Parameter::may_be_unusual)) return;
  // Prior of sizes beyond the usual one: without it, the excess would be attributed to another
  // effect.
  const Eigen::VectorXd largest = sizes_of(form, displacement, kSizes.back(), Largest::kPossible);
  add(largest.asDiagonal(), {1.0}, each + std::log(kUnusual), signs.size());
}

namespace {

// Matérn covariance of order 3/2 over the nodes of a table (a product over its axes), as its
// leading directions. `lengths`: by axis.
Eigen::MatrixXd smooth_directions(const Block& form, const std::vector<double>& lengths) {
  const auto n = static_cast<Eigen::Index>(form.terms.parameters.size());
  const auto at = [&](Eigen::Index node, std::size_t axis) {
    const TableReference& table =
        *form.terms.parameters[static_cast<std::size_t>(node)].terms.front().table;
    return table.axes[axis].nodes[static_cast<std::size_t>(table.index[axis])];
  };
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Ones(n, n);
  for (std::size_t axis = 0; axis < lengths.size(); ++axis) {
    for (Eigen::Index a = 0; a < n; ++a) {
      for (Eigen::Index b = 0; b < n; ++b) {
        const double z = std::sqrt(3.0) * std::abs(at(a, axis) - at(b, axis)) / lengths[axis];
        covariance(a, b) *= (1.0 + z) * std::exp(-z);
      }
    }
  }
  const SymmetricEigen eigen = symmetric_eigen(std::move(covariance));
  const double least = kSmallestDirection * eigen.values.maxCoeff();
  const Eigen::Index kept = (eigen.values.array() > least).count();
  return eigen.vectors.rightCols(kept) * eigen.values.tail(kept).cwiseSqrt().asDiagonal();
}

// Correlation lengths that a table's nodes can resolve: absolute ones on a joint, shares of the
// range elsewhere.
std::vector<std::vector<double>> lengths_of(const TableReference& table, bool is_joint) {
  std::vector<std::vector<double>> result;
  for (const double length : kLengths) {
    std::vector<double> lengths;
    for (const TableReference::Axis& axis : table.axes) {
      const double range = axis.nodes.back() - axis.nodes.front();
      const double spacing = range / static_cast<double>(axis.nodes.size() - 1);
      const double own = is_joint ? length : length * range;
      if (own > 0.8 * spacing) lengths.push_back(own);
    }
    if (lengths.size() == table.axes.size()) result.push_back(std::move(lengths));
  }
  return result;
}

}  // namespace

void add_table_shapes(const Block& form, bool is_joint, const Eigen::MatrixXd& columns,
                      const Linearization& l, std::vector<PriorShape>& shapes) {
  const TableReference& table = *form.terms.parameters.front().terms.front().table;
  const std::vector<std::vector<double>> lengths = lengths_of(table, is_joint);
  // With one unit at every node, a table moves the tool as one unit of its coordinate does.
  const double reach = l.displacement(columns.rowwise().sum());
  if (reach <= 0.0) return;
  for (const std::vector<double>& own : lengths) {
    PriorShape shape;
    shape.units = smooth_directions(form, own) / reach;
    shape.spread = shape.units;
    for (const double size : kSizes) {
      shape.scale.push_back(size);
      shape.log_prior.push_back(-std::log(static_cast<double>(kSizes.size() * lengths.size())));
    }
    shapes.push_back(std::move(shape));
  }
}

std::vector<Carrying> carrying_of(const EvidenceForm& form, const Fit& fit) {
  const State& state = fit.state();
  const auto load = find_effect(form.block.request.effect).carries();
  if (!load || !state.computes_torque()) return {};
  const std::vector<double>& torque = state.column(load->torque);
  const auto rows = static_cast<Eigen::Index>(torque.size());
  const Eigen::Map<const Eigen::VectorXd> against(torque.data(), rows);
  if (against.norm() <= 0.0) return {};
  Eigen::MatrixXd gives =
      Eigen::MatrixXd::Zero(rows, static_cast<Eigen::Index>(form.block.terms.parameters.size()));
  for (Eigen::Index c = 0; c < static_cast<Eigen::Index>(form.own); ++c) {
    const Parameter& p = form.block.terms.parameters[static_cast<std::size_t>(c)];
    if (p.terms.empty()) continue;
    const std::vector<double> basis = state.values(p.terms.front().basis);
    gives.col(c) = Eigen::Map<const Eigen::VectorXd>(basis.data(), rows);
  }
  double softness = 0.0;  // of the spring that the same load deflects
  for (const Parameter& p : fit.model().parameters) {
    const Term& term = p.terms.front();
    if (term.coordinate == form.block.terms.parameters.front().terms.front().coordinate &&
        term.basis.to_string() == load->torque)
      softness += std::abs(p.value);
  }
  return {{gives.transpose() * against / against.norm(), gives.transpose() * gives,
           softness * against.norm()}};
}

Eigen::MatrixXd compress(const Eigen::MatrixXd& columns, std::vector<PriorShape>& shapes) {
  if (columns.cols() <= kWide) return columns;
  const Eigen::VectorXd norm = columns.colwise().norm().cwiseMax(1e-300);
  const Eigen::MatrixXd unit = columns * norm.cwiseInverse().asDiagonal();
  const SymmetricEigen eigen = symmetric_eigen(square(unit));
  const Eigen::Index kept = (eigen.values.array() > kSpanned * eigen.values.maxCoeff()).count();
  const Eigen::MatrixXd vectors = eigen.vectors.rightCols(kept);
  const Eigen::VectorXd root = eigen.values.tail(kept).cwiseSqrt();
  for (PriorShape& shape : shapes)
    shape.spread = root.asDiagonal() * (vectors.transpose() * (norm.asDiagonal() * shape.spread));
  return unit * vectors * root.cwiseInverse().asDiagonal();
}

}  // namespace armtrue
