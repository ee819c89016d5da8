#include "fitter/evidence/noise.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"
#include "fitter/design/normal_equations.h"

namespace armtrue {
namespace {

// A part that fell to this share of the reading's own variance is none.
constexpr double kNone = 1e-8;
constexpr std::size_t kPosesLookedAt = 400;
constexpr Eigen::Index kFewestEquations = 3600, kEquationsPerColumn = 4;
constexpr Eigen::Index kTogether = 16;  // columns that one thread whitens at a time
// Each joint and the reading need so many equations beyond the number of columns. With fewer, one
// joint's scatter can explain all that is left, and readings seem to have no noise.
constexpr Eigen::Index kEquationsPerPart = 4;
// A variance becomes at least and at most this share of itself in one step.
constexpr int kStepsAfterChange = 5;
// Joints that are pooled begin with at least this share of the readings' variance.
constexpr double kLeastPooled = 0.1;
// A joint's variance that is not known to its own size is pooled without a test.
constexpr double kSurelyDoubtful = 1.0;
// Twice the logarithm of a likelihood that is nothing.
constexpr double kCannotBeTold = 0.01;
constexpr double kLeastShare = 0.05, kMostShare = 4.0;
// A climb has arrived where no part changes the variance of the readings by more than this share.
constexpr double kArrived = 2e-3;

// Added to the information of each part, as a share: the variance of parts that no data can tell
// apart becomes very large, not infinite.
constexpr double kLeastTold = 1e-9;

constexpr int kPositions = 3;  // equations of a row; those behind them are its orientation's

// Columns of every part within the equations of one pose.
struct PoseParts {
  std::vector<Eigen::Index> equations;
  std::vector<bool> turns;             // by equation: of an orientation
  std::vector<Eigen::MatrixXd> joint;  // by joint: equations × visits
  Eigen::MatrixXd shared;              // equations × 3
};

// Of every `stride`-th pose.
std::vector<PoseParts> parts_of_poses(const Linearization& l, std::size_t stride = 1) {
  std::vector<PoseParts> result;
  const std::vector<std::vector<std::size_t>> all = l.poses.rows_by_pose();
  for (std::size_t g = 0; g < all.size(); g += stride) {
    const std::vector<std::size_t>& rows = all[g];
    PoseParts pose;
    std::map<int, Eigen::Index> visits;
    for (const std::size_t row : rows) {
      visits.try_emplace(l.poses.visit_of_row[row], static_cast<Eigen::Index>(visits.size()));
      for (int h = 0; h < l.height; ++h) {
        pose.equations.push_back(static_cast<Eigen::Index>(row) * l.height + h);
        pose.turns.push_back(h >= kPositions);
      }
    }
    const auto size = static_cast<Eigen::Index>(pose.equations.size());
    pose.shared = l.translation(pose.equations, Eigen::all);
    for (int k = 0; k < l.layout.joints; ++k) {
      Eigen::MatrixXd columns =
          Eigen::MatrixXd::Zero(size, static_cast<Eigen::Index>(visits.size()));
      for (Eigen::Index e = 0; e < size; ++e) {
        const Eigen::Index equation = pose.equations[static_cast<std::size_t>(e)];
        const auto row = static_cast<std::size_t>(equation / l.height);
        columns(e, visits.at(l.poses.visit_of_row[row])) = l.geometry(equation, l.layout.motor(k));
      }
      pose.joint.push_back(std::move(columns));
    }
    result.push_back(std::move(pose));
  }
  return result;
}

Eigen::MatrixXd covariance_of(const PoseParts& pose, const NoiseParts& parts) {
  const Eigen::Index size = pose.shared.rows();
  Eigen::MatrixXd v = Eigen::MatrixXd::Zero(size, size);
  for (Eigen::Index e = 0; e < size; ++e)
    v(e, e) =
        std::pow(pose.turns[static_cast<std::size_t>(e)] ? parts.orientation : parts.reading, 2);
  for (std::size_t k = 0; k < pose.joint.size(); ++k) {
    const double variance = k < parts.joint.size() ? parts.joint[k] * parts.joint[k] : 0.0;
    if (variance > 0.0) v.noalias() += variance * (pose.joint[k] * pose.joint[k].transpose());
  }
  if (parts.pose)
    v.noalias() += *parts.pose * *parts.pose * (pose.shared * pose.shared.transpose());
  return v;
}

// L⁻¹ of the covariance LLᵀ.
Eigen::MatrixXd inverse_root_of(const PoseParts& pose, const NoiseParts& parts) {
  const Eigen::Index size = pose.shared.rows();
  return Cholesky(covariance_of(pose, parts)).half_solve(Eigen::MatrixXd::Identity(size, size));
}

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
  const Eigen::Index pieces = (columns.cols() + kTogether - 1) / kTogether;
  in_parallel(static_cast<std::size_t>(pieces), [&](std::size_t piece) {
    Eigen::VectorXd own(static_cast<Eigen::Index>(largest));
    const Eigen::Index first = static_cast<Eigen::Index>(piece) * kTogether;
    for (Eigen::Index c = first; c < std::min(first + kTogether, columns.cols()); ++c) {
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
  parts.reading = part_of(by_row.topRows(kPositions));
  parts.orientation =
      l.height > kPositions ? part_of(by_row.bottomRows(l.height - kPositions)) : parts.reading;
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
  const double turns = l.height > kPositions ? parts.orientation * parts.orientation : 0.0;
  return equations_that_count(static_cast<double>(l.rows()), positions + turns, positions);
}

namespace {

// The logarithm of the restricted likelihood, its slope by the variance of each part (reading,
// joints, pose, orientation), and the Fisher information of these variances.
struct Score {
  double value = 0.0;
  Eigen::VectorXd slope;
  Eigen::MatrixXd information;
};

void add_pose(const PoseParts& pose, const NoiseParts& parts, const Eigen::MatrixXd& inverse_root,
              const Eigen::MatrixXd& free, const Eigen::VectorXd& left, Score& score) {
  const auto root = inverse_root.triangularView<Eigen::Lower>();
  const auto size = static_cast<Eigen::Index>(pose.equations.size());
  std::vector<std::pair<Eigen::Index, Eigen::MatrixXd>> columns;  // of each part, whitened
  for (const bool turns : {false, true}) {
    std::vector<Eigen::Index> own;
    for (Eigen::Index e = 0; e < size; ++e) {
      if (pose.turns[static_cast<std::size_t>(e)] == turns) own.push_back(e);
    }
    if (!own.empty())
      columns.emplace_back(turns ? score.slope.size() - 1 : 0, inverse_root(Eigen::all, own));
  }
  for (std::size_t k = 0; k < pose.joint.size(); ++k) {
    if (parts.joint[k] > 0.0)
      columns.emplace_back(static_cast<Eigen::Index>(k) + 1, root * pose.joint[k]);
  }
  if (parts.pose && *parts.pose > 0.0)
    columns.emplace_back(score.slope.size() - 2, root * pose.shared);
  for (const auto& [part, own] : columns) {
    score.slope[part] += 0.5 * (own.transpose() * left).squaredNorm();
    const Eigen::MatrixXd freed = free * own;
    score.slope[part] -= 0.5 * own.cwiseProduct(freed).sum();
    for (const auto& [other, its] : columns)
      score.information(part, other) += 0.5 * (its.transpose() * freed).squaredNorm();
  }
}

// Fisher's step, in which no variance falls or grows by more than it may; those that would are held
// there, and the others go where that leaves them.
Eigen::VectorXd next_variances(const Eigen::VectorXd& variance, const Score& score) {
  std::vector<Eigen::Index> free;
  for (Eigen::Index i = 0; i < variance.size(); ++i) {
    if (variance[i] > 0.0 && score.information(i, i) > 0.0) free.push_back(i);
  }
  Eigen::VectorXd change = Eigen::VectorXd::Zero(variance.size());
  while (!free.empty()) {
    // In shares of each variance, so that radians and metres weigh alike.
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

// The equations of a pose stand side by side, so that its share of a matrix is one piece of memory.
class RestrictedLikelihood {
 public:
  RestrictedLikelihood(const Linearization& l, const Eigen::MatrixXd& columns,
                       const Eigen::MatrixXd& precision, const Eigen::VectorXd& y)
      : precision_(precision), poses_(parts_of_poses(l, stride_of(l, columns.cols()))) {
    std::vector<Eigen::Index> order;
    for (const PoseParts& pose : poses_)
      order.insert(order.end(), pose.equations.begin(), pose.equations.end());
    across_ = columns(order, Eigen::all).transpose();
    y_ = y(order);
  }

  // A few equations for every column tell variances to some hundredths: more would take as many
  // times as long.
  static std::size_t stride_of(const Linearization& l, Eigen::Index columns) {
    const Eigen::Index wanted = std::max(kFewestEquations, kEquationsPerColumn * columns);
    return static_cast<std::size_t>(std::max<Eigen::Index>(1, l.equations() / wanted));
  }

  Score score(const NoiseParts& parts) const;
  double poses() const { return static_cast<double>(poses_.size()); }

 private:
  const Eigen::MatrixXd& precision_;
  std::vector<PoseParts> poses_;
  Eigen::MatrixXd across_;  // unknowns × equations
  Eigen::VectorXd y_;
};

Score RestrictedLikelihood::score(const NoiseParts& parts) const {
  std::vector<Eigen::MatrixXd> roots;
  Eigen::MatrixXd white(across_.rows(), across_.cols());
  Eigen::VectorXd left(y_.size());
  Eigen::Index at = 0;
  for (const PoseParts& pose : poses_) {
    roots.push_back(inverse_root_of(pose, parts));
    const Eigen::Index size = roots.back().rows();
    white.middleCols(at, size).noalias() =
        across_.middleCols(at, size).lazyProduct(roots.back().transpose());
    left.segment(at, size) = roots.back().triangularView<Eigen::Lower>() * y_.segment(at, size);
    at += size;
  }
  const ScaledCholesky factor(precision_ + square_across(white));
  const Eigen::VectorXd moment = white * left;
  const Eigen::VectorXd coefficients = factor.solve(moment);
  double value = -0.5 * (left.squaredNorm() - moment.dot(coefficients) + factor.log_determinant());
  for (const Eigen::MatrixXd& root : roots) value += root.diagonal().array().log().sum();
  left -= white.transpose() * coefficients;

  // The sums that the steps compare are averages over poses: some hundreds of them say as much as
  // all.
  const std::size_t stride = std::max<std::size_t>(1, poses_.size() / kPosesLookedAt);
  std::vector<Eigen::Index> looked_at;
  at = 0;
  for (std::size_t g = 0; g < poses_.size(); ++g) {
    const auto size = static_cast<Eigen::Index>(poses_[g].equations.size());
    for (Eigen::Index e = 0; e < size && g % stride == 0; ++e) looked_at.push_back(at + e);
    at += size;
  }
  const Eigen::MatrixXd half = factor.half_solve(white(Eigen::all, looked_at));
  const Eigen::VectorXd seen = left(looked_at);
  const auto count = static_cast<Eigen::Index>(parts.joint.size()) + 3;
  Score score{value, Eigen::VectorXd::Zero(count), Eigen::MatrixXd::Zero(count, count)};
  at = 0;
  for (std::size_t g = 0; g < poses_.size(); g += stride) {
    const auto size = static_cast<Eigen::Index>(poses_[g].equations.size());
    const Eigen::MatrixXd free = Eigen::MatrixXd::Identity(size, size) -
                                 half.middleCols(at, size).transpose() * half.middleCols(at, size);
    add_pose(poses_[g], parts, roots[g], free, seen.segment(at, size), score);
    at += size;
  }
  return score;
}

Eigen::VectorXd variances_of(const NoiseParts& parts) {
  const auto joints = static_cast<Eigen::Index>(parts.joint.size());
  Eigen::VectorXd variance(joints + 3);
  variance[0] = parts.reading * parts.reading;
  for (Eigen::Index k = 0; k < joints; ++k)
    variance[k + 1] = std::pow(parts.joint[static_cast<std::size_t>(k)], 2);
  variance[joints + 1] = parts.pose ? *parts.pose * *parts.pose : 0.0;
  variance[joints + 2] = parts.orientation * parts.orientation;
  return variance;
}

// Which parts have one variance: by part, the first of those that have the same.
using Groups = std::vector<Eigen::Index>;

// Joints that slide and joints that turn are not alike: each kind has a group of its own.
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

// The score by the variances of groups, at each group's first part; zero at its others.
Score folded(const Score& score, const Groups& groups) {
  const auto count = static_cast<Eigen::Index>(groups.size());
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(count, count);
  for (Eigen::Index i = 0; i < count; ++i) sums(groups[static_cast<std::size_t>(i)], i) = 1.0;
  return {score.value, sums * score.slope, sums * score.information * sums.transpose()};
}

// Mean variance of a reading that one unit of each part's variance causes.
Eigen::VectorXd reaches(const Linearization& l) {
  Eigen::VectorXd reach(l.layout.joints + 3);
  const auto rows = static_cast<double>(l.geometry.rows());
  reach[0] = static_cast<double>(kPositions) / l.height;
  for (int k = 0; k < l.layout.joints; ++k)
    reach[k + 1] = l.geometry.col(l.layout.motor(k)).squaredNorm() / rows;
  reach[l.layout.joints + 1] = l.translation.squaredNorm() / rows;
  reach[l.layout.joints + 2] = 1.0 - reach[0];
  return reach;
}

NoiseParts climb(const RestrictedLikelihood& likelihood, const Linearization& l, NoiseParts parts,
                 int steps) {
  const auto joints = static_cast<Eigen::Index>(parts.joint.size());
  const Eigen::VectorXd reach = reaches(l);
  const Groups groups = groups_of(parts, l);
  for (int step = 0; step < steps; ++step) {
    const Eigen::VectorXd before = variances_of(parts);
    const Eigen::VectorXd variance =
        next_variances(before, folded(likelihood.score(parts), groups))(groups);
    parts.reading = std::sqrt(variance[0]);
    for (Eigen::Index k = 0; k < joints; ++k) {
      const auto at = static_cast<std::size_t>(k);
      const bool none =
          !parts.is_pooled(at) && variance[k + 1] * reach[k + 1] < kNone * variance[0];
      parts.joint[at] = none ? 0.0 : std::sqrt(variance[k + 1]);
    }
    if (parts.pose) parts.pose = std::sqrt(variance[joints + 1]);
    parts.orientation = std::sqrt(variance[joints + 2]);
    if ((variance - before).cwiseAbs().cwiseProduct(reach).maxCoeff() <
        kArrived * variance.dot(reach))
      break;
  }
  return parts;
}

// By joint, the relative variance of its own variance: infinite where that fell to zero, zero for
// joints that are pooled or move nothing.
Eigen::VectorXd doubts(const NoiseParts& parts, const Score& score, const Eigen::VectorXd& reach) {
  const Eigen::VectorXd variance = variances_of(parts);
  std::vector<Eigen::Index> there;
  for (Eigen::Index i = 0; i < variance.size(); ++i) {
    if (variance[i] > 0.0 && score.information(i, i) > 0.0) there.push_back(i);
  }
  const Eigen::VectorXd unit = variance(there);
  // Slides in three directions scatter as readings do. The variances of such parts are unknown.
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

// The joints that are pooled, and joint `k`, have one variance for each kind: that which moves the
// tool as much as theirs did together, and no less than it takes to be found.
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

// Climbs to `simpler`, from where `parts` are, and takes it unless twice the logarithm of the
// likelihood falls by more than `asked`.
bool gives_way(const RestrictedLikelihood& likelihood, const Linearization& l, NoiseParts& parts,
               NoiseParts simpler, double asked) {
  simpler = climb(likelihood, l, std::move(simpler), kStepsAfterChange);
  const double fall = likelihood.score(parts).value - likelihood.score(simpler).value;
  if (2.0 * fall > asked) return false;
  parts = std::move(simpler);
  return true;
}

// Leaves out what the data do not show. Whether a variance stands for itself, the Bayesian
// information criterion says, extended for the number of joints (Chen and Chen 2008, Biometrika 95,
// 759).
// A joint whose variance does not is pooled: every joint scatters, and the small scatter of one
// good joint is lost in the readings where that of all together is not. What the readings of a pose
// share becomes the readings' own if it does not stand for itself, and the variance of the pooled
// joints if the data could not tell it from theirs.
NoiseParts without_unsure(const RestrictedLikelihood& likelihood, const Linearization& l,
                          NoiseParts parts) {
  const Eigen::VectorXd reach = reaches(l);
  const double of_one_variance =
      std::log(likelihood.poses()) + 2.0 * std::log(static_cast<double>(parts.joint.size()));
  const auto add_to_readings = [&](NoiseParts& to, double sigma, double own_reach) {
    to.reading = std::hypot(to.reading, sigma * std::sqrt(own_reach / reach[0]));
  };
  const auto present_doubts = [&] {
    return doubts(parts, folded(likelihood.score(parts), groups_of(parts, l)), reach);
  };
  Eigen::VectorXd doubt = present_doubts();
  if (doubt.maxCoeff() > kSurelyDoubtful) {
    for (Eigen::Index k = 0; k < doubt.size(); ++k) {
      if (doubt[k] > kSurelyDoubtful) pool(parts, l, reach, static_cast<std::size_t>(k));
    }
    parts = climb(likelihood, l, std::move(parts), kStepsAfterChange);
    doubt = present_doubts();
  }
  for (Eigen::Index most = 0; doubt.maxCoeff(&most) > 0.0; doubt = present_doubts()) {
    NoiseParts simpler = parts;
    pool(simpler, l, reach, static_cast<std::size_t>(most));
    if (!gives_way(likelihood, l, parts, std::move(simpler), of_one_variance)) break;
  }
  if (parts.pose && *parts.pose > 0.0) {
    NoiseParts simpler = parts;
    simpler.pose = 0.0;
    add_to_readings(simpler, *parts.pose, reach[l.layout.joints + 1]);
    pool(simpler, l, reach);
    gives_way(likelihood, l, parts, std::move(simpler), of_one_variance);
  }
  for (const bool slides : {false, true}) {
    NoiseParts simpler = parts;
    for (std::size_t k = 0; k < parts.joint.size(); ++k) {
      if (!parts.is_pooled(k) || l.prismatic[k] != slides) continue;
      simpler.joint[k] = 0.0;
      add_to_readings(simpler, parts.joint[k], reach[static_cast<Eigen::Index>(k) + 1]);
    }
    if (simpler.joint != parts.joint)
      gives_way(likelihood, l, parts, std::move(simpler), kCannotBeTold);
  }
  return parts;
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
  parts = climb(likelihood, l, std::move(parts), effort.steps);
  return effort.drops_unsure && !few ? without_unsure(likelihood, l, std::move(parts)) : parts;
}

}  // namespace armtrue
