#include "fitter/evidence/search/elimination.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <map>
#include <random>

namespace armtrue {
namespace {

constexpr Eigen::Index kAllColumns = 24, kBlockWidth = 3;

struct Equations {
  Eigen::MatrixXd gram;
  Eigen::VectorXd gradient;
  double squares;
  std::mt19937_64 generator{7};

  Equations() {
    const Eigen::MatrixXd z = normal(60, kAllColumns), y = normal(60, 1);
    gram = z.transpose() * z;
    gradient = z.transpose() * y;
    squares = y.squaredNorm();
  }
  Eigen::MatrixXd normal(Eigen::Index rows, Eigen::Index columns) {
    std::normal_distribution<double> one;
    return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return one(generator); });
  }
};

// All columns with the members eliminated, from the definition: G − GW (I + WᵀGW)⁻¹ WᵀG.
struct Remainder {
  Eigen::MatrixXd gram;
  Eigen::VectorXd gradient;
  double squares, log_determinant;
};

Remainder remainder(const Equations& e, const std::map<std::size_t, Eigen::MatrixXd>& members) {
  Eigen::Index size = 0;
  for (const auto& [key, factor] : members) size += factor.cols();
  Eigen::MatrixXd w = Eigen::MatrixXd::Zero(kAllColumns, size);
  Eigen::Index at = 0;
  for (const auto& [key, factor] : members) {
    w.block(static_cast<Eigen::Index>(key) * kBlockWidth, at, kBlockWidth, factor.cols()) = factor;
    at += factor.cols();
  }
  const Eigen::MatrixXd inner = Eigen::MatrixXd::Identity(size, size) + w.transpose() * e.gram * w;
  const Eigen::MatrixXd kernel = inner.inverse();
  const Eigen::MatrixXd columns = e.gram * w;
  const Eigen::VectorXd along = w.transpose() * e.gradient;
  return {e.gram - columns * kernel * columns.transpose(), e.gradient - columns * kernel * along,
          e.squares - along.dot(kernel * along), std::log(inner.determinant())};
}

void expect_remainder(const Elimination& eliminated, const Equations& e,
                      const std::map<std::size_t, Eigen::MatrixXd>& members) {
  const Remainder expected = remainder(e, members);
  EXPECT_NEAR(eliminated.squares(), expected.squares, 1e-9);
  EXPECT_NEAR(eliminated.log_determinant(), expected.log_determinant, 1e-9);
  for (Eigen::Index first = 0; first < kAllColumns; first += kBlockWidth) {
    const Elimination::Local local = eliminated.beside(first, kBlockWidth);
    EXPECT_LT((local.gram - expected.gram.block(first, first, kBlockWidth, kBlockWidth)).norm(),
              1e-9);
    EXPECT_LT((local.gradient - expected.gradient.segment(first, kBlockWidth)).norm(), 1e-9);
    EXPECT_NEAR(local.squares, expected.squares, 1e-9);
    const Eigen::MatrixXd across = eliminated.across(first, kBlockWidth, 0, kBlockWidth);
    EXPECT_LT((across - expected.gram.block(first, 0, kBlockWidth, kBlockWidth)).norm(), 1e-9);
  }
}

TEST(Elimination, MembersAddedAndRemovedInAnyOrder_MatchesDefinition) {
  Equations e;
  Elimination eliminated(e.gram, e.gradient, e.squares);
  std::map<std::size_t, Eigen::MatrixXd> members;
  for (int step = 0; step < 200; ++step) {
    const std::size_t key = e.generator() % (kAllColumns / kBlockWidth);
    if (members.erase(key)) {
      eliminated.remove(key);
    } else {
      members[key] = e.normal(kBlockWidth, 1 + static_cast<Eigen::Index>(e.generator() % 3));
      eliminated.add(key, static_cast<Eigen::Index>(key) * kBlockWidth, members[key]);
    }
    expect_remainder(eliminated, e, members);
  }
}

// The data determine one member far better than its prior, which costs the definition digits.
TEST(Elimination, WithoutAMember_EqualsEliminationOfTheOthers) {
  Equations e;
  Elimination eliminated(e.gram, e.gradient, e.squares);
  std::map<std::size_t, Eigen::MatrixXd> members;
  for (const std::size_t key : {5U, 2U, 7U, 0U}) {
    members[key] = (key == 2U ? 1e4 : 1.0) * e.normal(kBlockWidth, 2);
    eliminated.add(key, static_cast<Eigen::Index>(key) * kBlockWidth, members[key]);
  }
  for (const auto& [key, factor] : members) {
    auto others = members;
    others.erase(key);
    const Remainder expected = remainder(e, others);
    const auto first = static_cast<Eigen::Index>(key) * kBlockWidth;
    const Elimination::Local local = eliminated.without(key);
    EXPECT_LT((local.gram - expected.gram.block(first, first, kBlockWidth, kBlockWidth)).norm(),
              1e-7);
    EXPECT_LT((local.gradient - expected.gradient.segment(first, kBlockWidth)).norm(), 1e-7);
    EXPECT_NEAR(local.squares, expected.squares, 1e-7);
  }
}

}  // namespace
}  // namespace armtrue
