#include "fitter/evidence/noise.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"
#include "fitter/design/normal_equations.h"
#include "fitter/evidence/restricted_likelihood.h"

namespace armtrue {
namespace {

constexpr Eigen::Index kTogether = 16;  // columns that one thread whitens at a time
// Each joint and the reading need this many equations beyond the number of columns. With fewer, one
// joint's scatter can explain all that is left, and readings seem to have no noise.
constexpr Eigen::Index kEquationsPerPart = 4;
// Least and largest factor by which a variance changes in one step.
constexpr double kLeastShare = 0.05, kMostShare = 4.0;
// The ascent has converged when no part changes the variance of the readings by more than this
// share.
constexpr double kArrived = 2e-3;
// Steps of the ascent after a part was removed or pooled.
constexpr int kStepsAfterChange = 5;
// A joint that adds less than this share of the reading's own variance to the readings gets
// variance 0.
constexpr double kNone = 1e-8;
// Joints that are pooled begin with at least this share of the readings' variance.
constexpr double kLeastPooled = 0.1;
// A joint is pooled without a test if its estimated variance has at least this relative variance.
constexpr double kSurelyDoubtful = 1.0;
// No driven joint scatters by more than this [rad or m]. A joint that hardly moves the reflector
// can seem to, because an error of the readings then looks the same as its own: it is pooled.
constexpr double kWorstJoint = 5e-3;
// Two models whose log-likelihoods, times two, differ by no more than this are equally likely.
constexpr double kCannotBeTold = 0.01;
// Added to the information of each part, as a share, so that parts that the data cannot separate
// get a very large variance instead of an infinite one.
constexpr double kLeastTold = 1e-9;

}  // namespace

PoseWhitening::PoseWhitening(const Linearization& linearization, const NoiseParts& parts) {
  NoiseParts weights = parts;
  weights.orientation = std::max(parts.orientation, parts.reading);
  for (PoseParts& pose : parts_of_poses(linearization)) {
    Eigen::MatrixXd inverse_root = inverse_root_of(pose, weights);
    blocks_.push_back({std::move(pose.equations), std::move(inverse_root)});
  }
}

void PoseWhitening::apply(Eigen::Ref<Eigen::MatrixXd> columns) const {
  std::size_t largest = 0;
  for (const Block& block : blocks_) largest = std::max(largest, block.equations.size());
  in_pieces(columns.cols(), kTogether, [&](Eigen::Index first, Eigen::Index end) {
    Eigen::VectorXd own(static_cast<Eigen::Index>(largest));
    for (Eigen::Index c = first; c < end; ++c) {
      double* column = columns.col(c).data();
      for (const Block& block : blocks_) {
        const auto size = static_cast<Eigen::Index>(block.equations.size());
        for (Eigen::Index e = 0; e < size; ++e)
          own[e] = column[block.equations[static_cast<std::size_t>(e)]];
        for (Eigen::Index e = 0; e < size; ++e) {
          column[block.equations[static_cast<std::size_t>(e)]] =
              block.inverse_root.row(e).head(e + 1).dot(own.head(e + 1));
        }
      }
    }
  });
}

NoiseParts broad_noise(const Linearization& l, const Eigen::VectorXd& residual) {
  NoiseParts parts;
  const double per_equation = residual.squaredNorm() / static_cast<double>(residual.size());
  const double n = l.layout.joints;
  const Eigen::Map<const Eigen::MatrixXd> by_row(residual.data(), l.height,
                                                 residual.size() / l.height);
  const auto part_of = [&](const auto& rows) {
    return std::sqrt(0.5 * rows.squaredNorm() / static_cast<double>(rows.size()));
  };
  parts.reading = part_of(by_row.topRows(kPositionEquations));
  parts.orientation = l.height > kPositionEquations
                          ? part_of(by_row.bottomRows(l.height - kPositionEquations))
                          : parts.reading;
  for (int k = 0; k < l.layout.joints; ++k) {
    const double reach =
        l.geometry.col(l.layout.motor(k)).squaredNorm() / static_cast<double>(residual.size());
    parts.joint.push_back(reach > 0.0 ? std::sqrt(0.5 * per_equation / n / reach) : 0.0);
  }
  if (l.poses.any_repeated()) parts.pose = l.typical_sigma * std::sqrt(per_equation);
  return parts;
}

double counted_equations(const Linearization& l, const NoiseParts& parts) {
  const double positions = parts.reading * parts.reading;
  const double turns = l.height > kPositionEquations ? parts.orientation * parts.orientation : 0.0;
  return equations_that_count(static_cast<double>(l.rows()), positions + turns, positions);
}

namespace {

// A step of Fisher scoring with bounds on the change of each variance. Changes that would exceed
// their bounds are set to them, and the step of the others is computed again.
Eigen::VectorXd next_variances(const Eigen::VectorXd& variance, const Score& score) {
  std::vector<Eigen::Index> free;
  for (Eigen::Index i = 0; i < variance.size(); ++i) {
    if (variance[i] > 0.0 && score.information(i, i) > 0.0) free.push_back(i);
  }
  Eigen::VectorXd change = Eigen::VectorXd::Zero(variance.size());
  while (!free.empty()) {
    // Relative to each variance, so that radians and metres are scaled alike.
    const Eigen::VectorXd unit = variance(free);
    const Eigen::MatrixXd information =
        unit.asDiagonal() * score.information(free, free) * unit.asDiagonal();
    const Eigen::VectorXd slope =
        unit.cwiseProduct((score.slope - score.information * change)(free));
    const Eigen::VectorXd share = least_squares(information, slope);
    std::vector<Eigen::Index> kept;
    for (std::size_t i = 0; i < free.size(); ++i) {
      const double own = share[static_cast<Eigen::Index>(i)];
      if (own > kLeastShare - 1.0 && own < kMostShare - 1.0) kept.push_back(free[i]);
    }
    for (std::size_t i = 0; i < free.size(); ++i) {
      const double own =
          std::clamp(share[static_cast<Eigen::Index>(i)], kLeastShare - 1.0, kMostShare - 1.0);
      if (kept.size() == free.size() || std::ranges::find(kept, free[i]) == kept.end())
        change[free[i]] = own * variance[free[i]];
    }
    if (kept.size() == free.size()) break;
    free = kept;
  }
  return variance + change;
}

// Parts that share one variance: by part, the first part of its group.
using Groups = std::vector<Eigen::Index>;

// Of the pooled joints, prismatic and revolute ones form a group each.
Groups groups_of(const NoiseParts& parts, const Linearization& l) {
  Groups groups(parts.joint.size() + 3);
  std::iota(groups.begin(), groups.end(), Eigen::Index{0});
  std::array<std::optional<Eigen::Index>, 2> first;
  for (std::size_t k = 0; k < parts.pooled.size(); ++k) {
    if (!parts.pooled[k]) continue;
    std::optional<Eigen::Index>& of_kind = first.at(l.prismatic[k] ? 1 : 0);
    if (!of_kind) of_kind = groups[k + 1];
    groups[k + 1] = *of_kind;
  }
  return groups;
}

// The score with respect to the variances of groups: at each group's first part, zero at the
// others.
Score folded(const Score& score, const Groups& groups) {
  const auto count = static_cast<Eigen::Index>(groups.size());
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(count, count);
  for (Eigen::Index i = 0; i < count; ++i) sums(groups[static_cast<std::size_t>(i)], i) = 1.0;
  return {score.value, sums * score.slope, sums * score.information * sums.transpose()};
}

// By part, in the order of Score: the variance that one unit of it adds to an equation, on average.
Eigen::VectorXd reaches(const Linearization& l) {
  Eigen::VectorXd reach(l.layout.joints + 3);
  const auto rows = static_cast<double>(l.geometry.rows());
  reach[0] = static_cast<double>(kPositionEquations) / l.height;
  for (int k = 0; k < l.layout.joints; ++k)
    reach[k + 1] = l.geometry.col(l.layout.motor(k)).squaredNorm() / rows;
  reach[l.layout.joints + 1] = l.translation.squaredNorm() / rows;
  reach[l.layout.joints + 2] = 1.0 - reach[0];
  return reach;
}

// An estimate, and its score, computed only when needed: that takes as long as all else together.
struct Estimate {
  NoiseParts parts;
  std::optional<Score> score;

  explicit Estimate(NoiseParts of) : parts(std::move(of)) {}
  const Score& scored(const RestrictedLikelihood& likelihood) {
    if (!score) score = likelihood.score(parts);
    return *score;
  }
};

Estimate climb(const RestrictedLikelihood& likelihood, const Linearization& l, Estimate at,
               int steps) {
  const auto joints = static_cast<Eigen::Index>(at.parts.joint.size());
  const Eigen::VectorXd reach = reaches(l);
  const Groups groups = groups_of(at.parts, l);
  for (int step = 0; step < steps; ++step) {
    const Eigen::VectorXd before = variances_of(at.parts);
    const Eigen::VectorXd variance =
        next_variances(before, folded(at.scored(likelihood), groups))(groups);
    at = Estimate(std::move(at.parts));
    at.parts.reading = std::sqrt(variance[0]);
    for (Eigen::Index k = 0; k < joints; ++k) {
      const auto joint = static_cast<std::size_t>(k);
      const bool none =
          !at.parts.is_pooled(joint) && variance[k + 1] * reach[k + 1] < kNone * variance[0];
      at.parts.joint[joint] = none ? 0.0 : std::sqrt(variance[k + 1]);
    }
    if (at.parts.pose) at.parts.pose = std::sqrt(variance[joints + 1]);
    at.parts.orientation = std::sqrt(variance[joints + 2]);
    if ((variance - before).cwiseAbs().cwiseProduct(reach).maxCoeff() <
        kArrived * variance.dot(reach))
      break;
  }
  return at;
}

// By joint, the relative variance of its estimated variance: infinite if the estimate is zero, zero
// if the joint is pooled or does not move the tool.
Eigen::VectorXd doubts(const NoiseParts& parts, const Score& score, const Eigen::VectorXd& reach) {
  const Eigen::VectorXd variance = variances_of(parts);
  std::vector<Eigen::Index> there;
  for (Eigen::Index i = 0; i < variance.size(); ++i) {
    if (variance[i] > 0.0 && score.information(i, i) > 0.0) there.push_back(i);
  }
  const Eigen::VectorXd unit = variance(there);
  // Prismatic joints in three directions scatter as readings do: no data separate their variances.
  Eigen::MatrixXd information =
      unit.asDiagonal() * score.information(there, there) * unit.asDiagonal();
  information.diagonal() *= 1.0 + kLeastTold;
  Eigen::VectorXd doubt =
      Eigen::VectorXd::Constant(variance.size(), std::numeric_limits<double>::infinity());
  doubt(there) = ScaledCholesky(information).inverse().diagonal();
  for (std::size_t k = 0; k < parts.joint.size(); ++k) {
    const auto at = static_cast<Eigen::Index>(k) + 1;
    if (parts.is_pooled(k) || reach[at] == 0.0) doubt[at] = 0.0;
  }
  return doubt.segment(1, static_cast<Eigen::Index>(parts.joint.size()));
}

// Gives the pooled joints, and joint `k`, one variance for each kind (revolute, prismatic). It
// moves the tool as much as their own variances together, and is large enough for the ascent to
// start.
void pool(NoiseParts& parts, const Linearization& l, const Eigen::VectorXd& reach,
          std::optional<std::size_t> k = std::nullopt) {
  parts.pooled.resize(parts.joint.size(), false);
  if (k) parts.pooled[*k] = true;
  for (const bool slides : {false, true}) {
    std::vector<std::size_t> alike;
    double moved = 0.0, lever = 0.0;
    for (std::size_t j = 0; j < parts.joint.size(); ++j) {
      if (!parts.pooled[j] || l.prismatic[j] != slides) continue;
      alike.push_back(j);
      moved += parts.joint[j] * parts.joint[j] * reach[static_cast<Eigen::Index>(j) + 1];
      lever += reach[static_cast<Eigen::Index>(j) + 1];
    }
    moved = std::max(moved, kLeastPooled * parts.reading * parts.reading * reach[0]);
    for (const std::size_t j : alike) parts.joint[j] = std::sqrt(moved / lever);
  }
}

// Starts the ascent from `simpler` and replaces `at` by the result, unless twice the log-likelihood
// falls by more than `asked`. Returns whether it did.
bool gives_way(const RestrictedLikelihood& likelihood, const Linearization& l, Estimate& at,
               NoiseParts simpler, double asked) {
  Estimate other = climb(likelihood, l, Estimate(std::move(simpler)), kStepsAfterChange);
  const double fall = at.scored(likelihood).value - other.scored(likelihood).value;
  if (2.0 * fall > asked) return false;
  at = std::move(other);
  return true;
}

// Removes parts that the data do not support, by the Bayesian information criterion extended for
// the number of joints (Chen and Chen 2008, Biometrika 95, 759).
// A joint whose own variance is not supported is pooled: every joint scatters, and the small
// scatter of one good joint is not seen beside the readings, but that of all together is.
// The variance that a pose's readings share is added to that of the readings if it is not
// supported. So is the pooled joints' variance if the data cannot separate it from the readings'.
NoiseParts without_unsure(const RestrictedLikelihood& likelihood, const Linearization& l,
                          Estimate at) {
  const Eigen::VectorXd reach = reaches(l);
  const double of_one_variance =
      std::log(likelihood.poses()) + 2.0 * std::log(static_cast<double>(at.parts.joint.size()));
  const auto add_to_readings = [&](NoiseParts& to, double sigma, double own_reach) {
    to.reading = std::hypot(to.reading, sigma * std::sqrt(own_reach / reach[0]));
  };
  const auto present_doubts = [&] {
    return doubts(at.parts, folded(at.scored(likelihood), groups_of(at.parts, l)), reach);
  };
  Eigen::VectorXd doubt = present_doubts();
  for (std::size_t k = 0; k < at.parts.joint.size(); ++k) {
    if (at.parts.joint[k] > kWorstJoint)
      doubt[static_cast<Eigen::Index>(k)] = std::numeric_limits<double>::infinity();
  }
  if (doubt.maxCoeff() > kSurelyDoubtful) {
    NoiseParts simpler = at.parts;
    for (Eigen::Index k = 0; k < doubt.size(); ++k) {
      if (doubt[k] > kSurelyDoubtful) pool(simpler, l, reach, static_cast<std::size_t>(k));
    }
    at = climb(likelihood, l, Estimate(std::move(simpler)), kStepsAfterChange);
    doubt = present_doubts();
  }
  for (Eigen::Index most = 0; doubt.maxCoeff(&most) > 0.0; doubt = present_doubts()) {
    NoiseParts simpler = at.parts;
    pool(simpler, l, reach, static_cast<std::size_t>(most));
    if (!gives_way(likelihood, l, at, std::move(simpler), of_one_variance)) break;
  }
  if (at.parts.pose && *at.parts.pose > 0.0) {
    NoiseParts simpler = at.parts;
    simpler.pose = 0.0;
    add_to_readings(simpler, *at.parts.pose, reach[l.layout.joints + 1]);
    pool(simpler, l, reach);
    gives_way(likelihood, l, at, std::move(simpler), of_one_variance);
  }
  for (const bool slides : {false, true}) {
    NoiseParts simpler = at.parts;
    for (std::size_t k = 0; k < at.parts.joint.size(); ++k) {
      if (!at.parts.is_pooled(k) || l.prismatic[k] != slides) continue;
      simpler.joint[k] = 0.0;
      add_to_readings(simpler, at.parts.joint[k], reach[static_cast<Eigen::Index>(k) + 1]);
    }
    if (simpler.joint != at.parts.joint)
      gives_way(likelihood, l, at, std::move(simpler), kCannotBeTold);
  }
  return at.parts;
}

}  // namespace

NoiseParts estimate_noise(const Linearization& l, const Eigen::MatrixXd& columns,
                          const Eigen::MatrixXd& precision, const Eigen::VectorXd& y,
                          const NoiseParts& start, const NoiseEffort& effort) {
  const RestrictedLikelihood likelihood(l, columns, precision, y);
  NoiseParts parts = start;
  parts.joint.resize(static_cast<std::size_t>(l.layout.joints), 0.0);
  const bool few = y.size() - columns.cols() < kEquationsPerPart * (l.layout.joints + 1);
  if (few) {
    std::ranges::fill(parts.joint, 0.0);
    if (parts.pose) parts.pose = 0.0;
  }
  Estimate at = climb(likelihood, l, Estimate(std::move(parts)), effort.steps);
  return effort.drops_unsure && !few ? without_unsure(likelihood, l, std::move(at)) : at.parts;
}

}  // namespace armtrue
