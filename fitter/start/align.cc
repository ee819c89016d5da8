#include "fitter/start/align.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "fitter/common/dense.h"
#include "fitter/common/statistics.h"
#include "fitter/model/kinematics.h"

namespace armtrue {
namespace {

constexpr std::size_t kMultiStartRows = 200;
constexpr std::size_t kFewestRows = 4;
// Set-ups further apart than this count as separate: the error of the nominal arm is smaller.
constexpr double kSetUpsApart = 0.01;  // [m, or rad]
constexpr int kWeightPasses = 6;
// Weight of the tool's distance from its stated position, as a share of the points' total weight.
// It attributes to the base any offset that the points cannot separate between base and tool (a
// height, if all axes of rotation are vertical).
constexpr double kToolIsWhereBelieved = 1e-9;

// If the least element of a Cholesky factor's diagonal exceeds this share of the largest, the
// solution is accurate to 1e-8.
constexpr double kSurelySolved = 1e-4;

// Flange poses in the base and measured points: all that alignment needs of the arm.
struct Pairs {
  std::vector<Pose> base_from_flange;
  Eigen::Matrix3Xd point;
  std::vector<int> target;
  int targets = 1;
  Eigen::Matrix3Xd believed_tool;  // 3 × targets

  Eigen::Index size() const { return point.cols(); }
};

struct Guess {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  // measuring from base
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  Eigen::Matrix3Xd tool;  // 3 × targets
};

Eigen::Vector3d predict(const Pairs& pairs, const Guess& guess, Eigen::Index i) {
  const auto row = static_cast<std::size_t>(i);
  return guess.rotation *
             (pairs.base_from_flange[row] * Eigen::Vector3d(guess.tool.col(pairs.target[row]))) +
         guess.translation;
}

Eigen::VectorXd distances(const Pairs& pairs, const Guess& guess) {
  Eigen::VectorXd result(pairs.size());
  for (Eigen::Index i = 0; i < pairs.size(); ++i)
    result[i] = (pairs.point.col(i) - predict(pairs, guess, i)).norm();
  return result;
}

// Cauchy weights on a robust scale: bumped reflectors get little weight, ordinary errors keep
// theirs.
Eigen::VectorXd robust_weights(const Eigen::VectorXd& distance) {
  const double scale = std::max(
      1e-9, 2.0 * median(std::vector<double>(distance.data(), distance.data() + distance.size())));
  return (1.0 + (distance.array() / scale).square()).inverse();
}

// The rotation R of largest trace RᵀM: its quaternion is the eigenvector of a symmetric matrix
// (Horn 1987, J. Opt. Soc. Am. A 4, 629).
Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& m) {
  const Eigen::Vector3d turn(m(2, 1) - m(1, 2), m(0, 2) - m(2, 0), m(1, 0) - m(0, 1));
  Eigen::MatrixXd known(4, 4);
  known(0, 0) = m.trace();
  known.block<3, 1>(1, 0) = turn;
  known.block<3, 3>(1, 1) = m + m.transpose() - m.trace() * Eigen::Matrix3d::Identity();
  const Eigen::VectorXd q = symmetric_eigen(std::move(known)).vectors.col(3);
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
}

// The relaxation: rows [x ⊗ I, −R_i, −I] · [vec(A); t; b'] = p_i, with A standing for Rᵀ / scale.
Eigen::Matrix3d relaxed_inverse_rotation(const Pairs& pairs) {
  const Eigen::Index unknowns = 12 + 3 * pairs.targets;
  const Eigen::Vector3d centre = pairs.point.rowwise().mean();
  const double spread = std::max(1e-12, (pairs.point.colwise() - centre).norm() /
                                            std::sqrt(static_cast<double>(pairs.size())));
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(3 * pairs.size(), unknowns);
  Eigen::VectorXd right(3 * pairs.size());
  for (Eigen::Index i = 0; i < pairs.size(); ++i) {
    const auto row = static_cast<std::size_t>(i);
    const Eigen::Vector3d x = (pairs.point.col(i) - centre) / spread;
    for (int c = 0; c < 3; ++c) rows.block<3, 3>(3 * i, 3 * c) = x[c] * Eigen::Matrix3d::Identity();
    rows.block<3, 3>(3 * i, 9) = -Eigen::Matrix3d::Identity();
    rows.block<3, 3>(3 * i, 12 + 3 * pairs.target[row]) = -pairs.base_from_flange[row].linear();
    right.segment<3>(3 * i) = pairs.base_from_flange[row].translation();
  }
  Eigen::VectorXd solution;
  Eigen::VectorXd weight = Eigen::VectorXd::Ones(pairs.size());
  for (int pass = 0; pass < kWeightPasses; ++pass) {
    Eigen::VectorXd expanded(3 * pairs.size());
    for (Eigen::Index i = 0; i < pairs.size(); ++i)
      expanded.segment<3>(3 * i).setConstant(std::sqrt(weight[i]));
    const Eigen::MatrixXd weighted = expanded.asDiagonal() * rows;
    const Eigen::MatrixXd normal = square(weighted);
    const Eigen::VectorXd gradient = weighted.transpose() * expanded.cwiseProduct(right);
    solution = least_squares(normal, gradient);
    const Eigen::VectorXd left_over = right - rows * solution;
    Eigen::VectorXd distance(pairs.size());
    for (Eigen::Index i = 0; i < pairs.size(); ++i)
      distance[i] = left_over.segment<3>(3 * i).norm();
    weight = robust_weights(distance);
  }
  return Eigen::Map<const Eigen::Matrix3d>(solution.data()) / spread;
}

// Normal equations of rows with kShared unknowns common to all reflectors, and three of their own
// reflector. The sizes are template arguments for speed: a file that does not align is tried from
// dozens of starts.
template <int kShared>
class ByTarget {
 public:
  using Row = Eigen::Matrix<double, 3, kShared + 3>;

  explicit ByTarget(int targets)
      : normal_(static_cast<std::size_t>(targets), Square::Zero()),
        right_(static_cast<std::size_t>(targets), Column::Zero()) {}

  void add(int target, double weight, const Row& row, const Eigen::Vector3d& y) {
    const auto t = static_cast<std::size_t>(target);
    normal_[t].noalias() += weight * row.transpose().lazyProduct(row);
    right_[t].noalias() += weight * row.transpose().lazyProduct(y);
  }

  /// `believed`: weight that draws tools towards `tool`, 3 × targets.
  Eigen::VectorXd solve(double believed, const Eigen::Matrix3Xd& tool) const {
    const auto targets = static_cast<Eigen::Index>(normal_.size());
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(kShared + 3 * targets, kShared + 3 * targets);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(normal.rows());
    for (Eigen::Index t = 0; t < targets; ++t) {
      const Square& own = normal_[static_cast<std::size_t>(t)];
      const Column& y = right_[static_cast<std::size_t>(t)];
      const Eigen::Index at = kShared + 3 * t;
      normal.topLeftCorner<kShared, kShared>() += own.template topLeftCorner<kShared, kShared>();
      normal.block<kShared, 3>(0, at) = own.template topRightCorner<kShared, 3>();
      normal.block<3, kShared>(at, 0) = own.template bottomLeftCorner<3, kShared>();
      normal.block<3, 3>(at, at) = own.template bottomRightCorner<3, 3>();
      right.head<kShared>() += y.template head<kShared>();
      right.segment<3>(at) = y.template tail<3>() + believed * tool.col(t);
    }
    normal.diagonal().tail(3 * targets).array() += believed;
    const Cholesky factor(normal);
    const auto edge = factor.lower().diagonal();
    if (factor.ok() && edge.minCoeff() > kSurelySolved * edge.maxCoeff())
      return factor.solve(right);
    return least_squares(std::move(normal), right);
  }

 private:
  using Square = Eigen::Matrix<double, kShared + 3, kShared + 3>;
  using Column = Eigen::Matrix<double, kShared + 3, 1>;
  std::vector<Square> normal_;
  std::vector<Column> right_;
};

// Solves for translation and tools, which are linear at a given rotation.
void solve_translation_and_tools(const Pairs& pairs, const Eigen::VectorXd& weight, Guess& guess) {
  ByTarget<3> equations(pairs.targets);
  ByTarget<3>::Row row;
  row.leftCols<3>().setIdentity();
  for (Eigen::Index i = 0; i < pairs.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    row.rightCols<3>() = guess.rotation * pairs.base_from_flange[k].linear();
    equations.add(pairs.target[k], weight[i], row,
                  pairs.point.col(i) - guess.rotation * pairs.base_from_flange[k].translation());
  }
  const Eigen::VectorXd solution =
      equations.solve(kToolIsWhereBelieved * weight.sum(), pairs.believed_tool);
  guess.translation = solution.head<3>();
  guess.tool = Eigen::Map<const Eigen::Matrix3Xd>(solution.data() + 3, 3, pairs.targets);
}

double refine(const Pairs& pairs, int iterations, Guess& guess) {
  Eigen::VectorXd weight = Eigen::VectorXd::Ones(pairs.size());
  solve_translation_and_tools(pairs, weight, guess);
  ByTarget<6>::Row row;
  row.leftCols<3>().setIdentity();
  for (int iteration = 0; iteration < iterations; ++iteration) {
    weight = robust_weights(distances(pairs, guess));
    ByTarget<6> equations(pairs.targets);
    for (Eigen::Index i = 0; i < pairs.size(); ++i) {
      const auto k = static_cast<std::size_t>(i);
      const Eigen::Vector3d turned =
          guess.rotation *
          (pairs.base_from_flange[k] * Eigen::Vector3d(guess.tool.col(pairs.target[k])));
      for (int c = 0; c < 3; ++c) row.col(3 + c) = Eigen::Vector3d::Unit(c).cross(turned);
      row.rightCols<3>() = guess.rotation * pairs.base_from_flange[k].linear();
      equations.add(pairs.target[k], weight[i], row,
                    pairs.point.col(i) - turned - guess.translation);
    }
    const Eigen::VectorXd step = equations.solve(0.0, pairs.believed_tool);
    const double turn = step.segment<3>(3).norm();
    guess.rotation =
        rotation_exp(step.segment<3>(3) * std::min(1.0, 0.5 / std::max(turn, 1e-300))) *
        guess.rotation;
    solve_translation_and_tools(pairs, weight, guess);
    if (turn < 1e-10) break;
  }
  const Eigen::VectorXd distance = distances(pairs, guess);
  weight = robust_weights(distance);
  return std::sqrt(weight.dot(distance.cwiseAbs2()) / weight.sum());
}

std::vector<Eigen::Matrix3d> cube_rotations() {
  std::vector<Eigen::Matrix3d> rotations;
  for (int x = 0; x < 3; ++x) {
    for (int y = 0; y < 3; ++y) {
      if (x == y) continue;
      for (const double sx : {1.0, -1.0}) {
        for (const double sy : {1.0, -1.0}) {
          Eigen::Matrix3d r;
          r.col(0) = sx * Eigen::Vector3d::Unit(x);
          r.col(1) = sy * Eigen::Vector3d::Unit(y);
          r.col(2) = r.col(0).cross(r.col(1));
          rotations.push_back(r);
        }
      }
    }
  }
  return rotations;
}

Pairs chosen(const Pairs& pairs, const std::vector<std::size_t>& rows) {
  Pairs some;
  some.targets = pairs.targets;
  some.believed_tool = pairs.believed_tool;
  some.point = pairs.point(Eigen::all, rows);
  for (const std::size_t row : rows) {
    some.base_from_flange.push_back(pairs.base_from_flange[row]);
    some.target.push_back(pairs.target[row]);
  }
  return some;
}

Pairs thin_out(const Pairs& pairs) {
  const auto count = static_cast<std::size_t>(pairs.size());
  if (count <= kMultiStartRows) return pairs;
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < kMultiStartRows; ++i) rows.push_back(i * count / kMultiStartRows);
  return chosen(pairs, rows);
}

// Units of the points per metre; 1 if they are in metres. Points in a plane do not determine the
// third direction of the relaxed rotation, so its middle singular value is used.
double unit_of(const Pairs& pairs) {
  const Eigen::Matrix3d relaxed = relaxed_inverse_rotation(pairs);
  const double square_size = symmetric_eigen(relaxed * relaxed.transpose()).values[1];
  const double unit = 1.0 / std::sqrt(std::max(square_size, 1e-300));
  return (unit > 0.8 && unit < 1.25) || unit > 1e5 || unit < 1e-5 ? 1.0 : unit;
}

// The best result of several starts, refined on at most kMultiStartRows rows.
Guess find_base_and_tools(const Pairs& pairs, const Robot& robot) {
  const Pairs some = thin_out(pairs);
  Guess best;
  double best_error = std::numeric_limits<double>::infinity();
  const auto offer = [&](const Eigen::Matrix3d& rotation, int iterations) {
    Guess guess;
    guess.rotation = rotation;
    const double error = refine(some, iterations, guess);
    if (error < best_error) {
      best_error = error;
      best = guess;
    }
  };
  offer(nearest_rotation(relaxed_inverse_rotation(pairs).transpose()), 30);
  if (robot.measuring_from_base) offer(robot.measuring_from_base->linear(), 30);
  if (best_error > 0.005 * robot.reach()) {
    for (const Eigen::Matrix3d& rotation : cube_rotations()) offer(rotation, 40);
  }
  return best;
}

using SetUps = std::map<int, std::vector<std::size_t>>;  // rows by number

// Empty if the column is missing or contains a fraction.
SetUps set_ups_of(const State& state) {
  SetUps result;
  if (!state.recorded("station")) return result;
  const std::vector<double>& column = state.column("station");
  for (std::size_t i = 0; i < column.size(); ++i) {
    if (column[i] != std::round(column[i])) return {};
    result[static_cast<int>(column[i])].push_back(i);
  }
  return result;
}

// The rotation and shift from measured points to those that `guess` predicts (Horn 1987).
Pose expected_from_measured(const Pairs& pairs, const Guess& guess) {
  Pose pose = Pose::Identity();
  Eigen::VectorXd weight = Eigen::VectorXd::Ones(pairs.size());
  Eigen::Matrix3Xd expected(3, pairs.size());
  for (Eigen::Index i = 0; i < pairs.size(); ++i) expected.col(i) = predict(pairs, guess, i);
  for (int pass = 0; pass < kWeightPasses; ++pass) {
    const Eigen::Vector3d to = expected * weight / weight.sum();
    const Eigen::Vector3d from = pairs.point * weight / weight.sum();
    pose.linear() = nearest_rotation((expected.colwise() - to) * weight.asDiagonal() *
                                     (pairs.point.colwise() - from).transpose());
    pose.translation() = to - pose.linear() * from;
    weight = robust_weights((expected - pose * pairs.point).colwise().norm().transpose());
  }
  return pose;
}

// Moves the points of set-ups that stand apart into the first one's frame.
std::map<int, Pose> bring_together(Pairs& pairs, const Robot& robot, const SetUps& set_ups) {
  std::map<int, Pose> result;
  if (set_ups.size() < 2 || set_ups.begin()->second.size() < kFewestRows) return result;
  const Pairs first = chosen(pairs, set_ups.begin()->second);
  Guess guess = find_base_and_tools(first, robot);
  refine(first, 30, guess);
  for (const auto& [number, rows] : set_ups) {
    if (number == set_ups.begin()->first || rows.size() < kFewestRows) continue;
    const Pose pose = expected_from_measured(chosen(pairs, rows), guess);
    if (pose.translation().norm() < kSetUpsApart &&
        rotation_log(pose.linear()).norm() < kSetUpsApart)
      continue;
    result.emplace(number, pose);
    for (const std::size_t row : rows)
      pairs.point.col(static_cast<Eigen::Index>(row)) =
          pose * Eigen::Vector3d(pairs.point.col(static_cast<Eigen::Index>(row)));
  }
  return result;
}

// Umeyama's scale: how much larger the measured cloud is than the predicted one.
double similarity_scale(const Pairs& pairs, const Guess& guess) {
  Eigen::Matrix3Xd predicted(3, pairs.size());
  for (Eigen::Index i = 0; i < pairs.size(); ++i) predicted.col(i) = predict(pairs, guess, i);
  const Eigen::Matrix3Xd a = pairs.point.colwise() - Eigen::Vector3d(pairs.point.rowwise().mean());
  const Eigen::Matrix3Xd b = predicted.colwise() - Eigen::Vector3d(predicted.rowwise().mean());
  const double power = b.squaredNorm();
  return power > 0.0 ? a.cwiseProduct(b).sum() / power : 1.0;
}

Eigen::Matrix3d mean_rotation(const std::vector<Eigen::Matrix3d>& rotations) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (const Eigen::Matrix3d& r : rotations) sum += r;
  return nearest_rotation(sum);
}

}  // namespace

const Pose* set_up_of(const std::map<int, Pose>& first_from_set_up, const State::Columns& columns,
                      std::size_t row) {
  const auto station = columns.find("station");
  if (station == columns.end()) return nullptr;
  const auto at = first_from_set_up.find(static_cast<int>(station->second[row]));
  return at == first_from_set_up.end() ? nullptr : &at->second;
}

Alignment align(const State& state, const Measurements& measurements) {
  if (measurements.rows < kFewestRows) {
    throw ModelError("measurements: found " + std::to_string(measurements.rows) +
                     " usable rows, expected at least 4 to find base and tool");
  }
  const Robot& robot = state.robot();
  Kinematics kinematics(robot, 1);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(kinematics.layout().size());
  const auto n = static_cast<std::size_t>(robot.joint_count());
  Pairs pairs;
  pairs.point = measurements.position;
  pairs.target = measurements.target;
  pairs.targets = measurements.targets;
  pairs.believed_tool = Eigen::Matrix3Xd::Zero(3, measurements.targets);
  for (int t = 0; t < measurements.targets; ++t) {
    if (const auto tool = robot.nominal_tool(t)) pairs.believed_tool.col(t) = tool->translation();
  }
  for (std::size_t i = 0; i < measurements.rows; ++i) {
    pairs.base_from_flange.push_back(kinematics.forward(&state.joints()[i * n], zero.data(), 0));
  }

  // Points in another unit, such as millimetres, are scaled to metres first, so that the tool comes
  // out in metres.
  const SetUps set_ups = set_ups_of(state);
  const double unit =
      unit_of(thin_out(set_ups.empty() ? pairs : chosen(pairs, set_ups.begin()->second)));
  pairs.point /= unit;
  Alignment result;
  result.first_from_set_up = bring_together(pairs, robot, set_ups);
  Guess best = find_base_and_tools(pairs, robot);
  const double error = refine(pairs, 30, best);
  for (auto& [number, pose] : result.first_from_set_up) pose.translation() *= unit;

  result.scale = unit * similarity_scale(pairs, best);
  result.rms_m = error;
  result.measuring_from_base.linear() = best.rotation;
  result.measuring_from_base.translation() = best.translation * unit;
  const Eigen::VectorXd distance = distances(pairs, best);
  result.residual_m.assign(distance.data(), distance.data() + distance.size());
  for (int t = 0; t < measurements.targets; ++t) {
    Pose tool = Pose::Identity();
    tool.translation() = best.tool.col(t);
    if (measurements.has_rotation()) {
      std::vector<Eigen::Matrix3d> seen;
      for (std::size_t i = 0; i < measurements.rows; ++i) {
        if (measurements.target[i] != t) continue;
        Eigen::Matrix3d measured = measurements.rotation[i];
        if (const Pose* pose = set_up_of(result.first_from_set_up, state.columns(), i))
          measured = pose->linear() * measured;
        seen.push_back((best.rotation * pairs.base_from_flange[i].linear()).transpose() * measured);
      }
      if (!seen.empty()) tool.linear() = mean_rotation(seen);
    }
    result.flange_from_tool.push_back(tool);
  }
  return result;
}

}  // namespace armtrue
