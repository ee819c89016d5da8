#include "fitter/evidence/search/elimination.h"

#include <algorithm>
#include <limits>

#include "fitter/common/dense.h"

namespace armtrue {
namespace {

constexpr Eigen::Index kLeastRoom = 64;
// without() restores a member from its own eliminated columns. That loses twice as many digits as
// the data add to the prior; below this squared pivot without_exactly() is used.
constexpr double kLeastPivot = 1e-5;

// Rounding can make the matrix indefinite if the data know a direction far better than its prior.
void factorise(Eigen::MatrixXd& matrix) {
  const Eigen::MatrixXd given = matrix;
  if (factorise_cholesky(matrix)) return;
  matrix = given;
  matrix.diagonal().array() +=
      std::numeric_limits<double>::epsilon() * static_cast<double>(given.rows()) * given.trace();
  factorise_cholesky(matrix);
}

// Moves `count` rows from `first` on up by `by`.
void move_up(Eigen::Ref<Eigen::MatrixXd> matrix, Eigen::Index first, Eigen::Index count,
             Eigen::Index by) {
  for (Eigen::Index c = 0; c < matrix.cols(); ++c) {
    double* column = matrix.col(c).data() + first;
    std::copy(column, column + count, column - by);
  }
}

}  // namespace

Elimination::Elimination(const Eigen::MatrixXd& gram, const Eigen::VectorXd& gradient,
                         double squares)
    : gram_(gram),
      gradient_(gradient),
      squares_(squares),
      known_(static_cast<std::size_t>(gram.cols()), 0) {
  reserve(kLeastRoom);
}

void Elimination::reserve(Eigen::Index size) {
  if (size <= half_.rows()) return;
  const Eigen::Index room = std::max(size, 2 * half_.rows());
  Eigen::MatrixXd root = Eigen::MatrixXd::Zero(room, room), half(room, gram_.cols());
  if (size_ > 0) {
    root.topLeftCorner(size_, size_) = root_.topLeftCorner(size_, size_);
    half.topRows(size_) = half_.topRows(size_);
  }
  root_ = std::move(root);
  half_ = std::move(half);
  along_.conservativeResize(room);
}

// Works out the missing rows of `width` columns of half_ from `first` on. After most changes of the
// members only a few columns are looked at, so that the others need not be worked out.
void Elimination::complete(Eigen::Index first, Eigen::Index width) const {
  const auto begin = known_.begin() + first;
  const Eigen::Index from = *std::min_element(begin, begin + width), rest = size_ - from;
  if (rest == 0) return;
  Eigen::MatrixXd rows(rest, width);
  for (const Member& m : members_) {
    if (m.first >= from)
      rows.middleRows(m.first - from, m.size) =
          transpose_times(m.factor, gram_.block(m.column, first, m.factor.rows(), width));
  }
  if (from > 0) rows -= times(root_.block(from, 0, rest, from), half_.block(0, first, from, width));
  solve_lower(root_.block(from, from, rest, rest), rows);
  half_.block(from, first, rest, width) = rows;
  std::fill(begin, begin + width, size_);
}

void Elimination::add(std::size_t key, Eigen::Index first, const Eigen::MatrixXd& factor) {
  const Eigen::Index size = factor.cols(), width = factor.rows();
  reserve(size_ + size);
  complete(first, width);
  Eigen::MatrixXd inner = Eigen::MatrixXd::Identity(size, size) +
                          congruent(gram_.block(first, first, width, width), factor);
  Eigen::MatrixXd right = factor.transpose() * gradient_.segment(first, width);
  if (size_ > 0) {
    const Eigen::MatrixXd before = half_.block(0, first, size_, width) * factor;
    root_.block(size_, 0, size, size_) = before.transpose();
    inner -= square(before);
    right -= before.transpose() * along_.head(size_);
  }
  factorise(inner);
  solve_lower(inner, right);
  root_.block(size_, size_, size, size) = inner.triangularView<Eigen::Lower>();
  along_.segment(size_, size) = right;
  members_.push_back({key, size_, size, first, factor});
  size_ += size;
}

std::vector<Elimination::Member>::const_iterator Elimination::find(std::size_t key) const {
  return std::find_if(members_.begin(), members_.end(),
                      [&](const Member& m) { return m.key == key; });
}

void Elimination::remove(std::size_t key) {
  const auto at = find(key);
  if (at == members_.end()) return;
  const Member gone = *at;
  const Eigen::Index after = gone.first + gone.size, rest = size_ - after;
  if (rest > 0) {
    // Members eliminated after the removed one regain what they had in common with it.
    const GrownFactor now(root_.block(after, after, rest, rest),
                          root_.block(after, gone.first, rest, gone.size));
    now.turn(along_.segment(after, rest), along_.segment(gone.first, gone.size));
    move_up(root_.leftCols(gone.first), after, rest, gone.size);
    root_.block(gone.first, gone.first, rest, rest) = now.factor();
    move_up(along_, after, rest, gone.size);
  }
  for (Eigen::Index& rows : known_) rows = std::min(rows, gone.first);
  size_ -= gone.size;
  members_.erase(at);
  for (Member& m : members_) {
    if (m.first > gone.first) m.first -= gone.size;
  }
}

Elimination::Local Elimination::beside(Eigen::Index first, Eigen::Index width) const {
  Local local{gram_.block(first, first, width, width), gradient_.segment(first, width), squares()};
  if (size_ == 0) return local;
  complete(first, width);
  const auto half = half_.block(0, first, size_, width);
  local.gram -= square(half);
  local.gradient -= half.transpose() * along_.head(size_);
  return local;
}

Elimination::Local Elimination::without(std::size_t key) const {
  const Member& member = *find(key);
  Local local = beside(member.column, member.factor.rows());
  const Eigen::MatrixXd columns = local.gram * member.factor;
  const Cholesky kernel(Eigen::MatrixXd::Identity(member.size, member.size) -
                        member.factor.transpose() * columns);
  if (!kernel.ok() || kernel.lower().diagonal().cwiseAbs2().minCoeff() < kLeastPivot)
    return without_exactly(member);
  const Eigen::VectorXd along = member.factor.transpose() * local.gradient;
  const Eigen::VectorXd back = kernel.solve(along);
  local.squares += along.dot(back);
  local.gradient += columns * back;
  local.gram += columns * kernel.solve_matrix(columns.transpose());
  return local;
}

// The same, from the factor of the other members alone.
Elimination::Local Elimination::without_exactly(const Member& member) const {
  const Eigen::Index first = member.column, width = member.factor.rows();
  const Eigen::Index before = member.first, after = before + member.size, rest = size_ - after;
  Local local{gram_.block(first, first, width, width), gradient_.segment(first, width),
              squares_ - along_.head(before).squaredNorm()};
  const auto take = [&](const Eigen::MatrixXd& half, const Eigen::VectorXd& along) {
    local.gram -= square(half);
    local.gradient -= half.transpose() * along;
  };
  if (before > 0) take(half_.block(0, first, before, width), along_.head(before));
  if (rest == 0) return local;
  const GrownFactor now(root_.block(after, after, rest, rest),
                        root_.block(after, before, rest, member.size));
  Eigen::VectorXd along = along_.segment(after, rest), own = along_.segment(before, member.size);
  now.turn(along, own);
  Eigen::MatrixXd half = half_.block(after, first, rest, width);
  Eigen::MatrixXd its = half_.block(before, first, member.size, width);
  now.turn(half, its);
  take(half, along);
  local.squares -= along.squaredNorm();
  return local;
}

Eigen::MatrixXd Elimination::across(Eigen::Index first, Eigen::Index width, Eigen::Index other,
                                    Eigen::Index other_width) const {
  Eigen::MatrixXd result = gram_.block(first, other, width, other_width);
  if (size_ > 0) {
    complete(first, width);
    complete(other, other_width);
    result -= transpose_times(half_.block(0, first, size_, width),
                              half_.block(0, other, size_, other_width));
  }
  return result;
}

double Elimination::log_determinant() const {
  return 2.0 * root_.diagonal().head(size_).array().log().sum();
}

}  // namespace armtrue
