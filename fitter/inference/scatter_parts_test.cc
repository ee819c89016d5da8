#include "fitter/inference/scatter_parts.h"

#include <gtest/gtest.h>

#include "fitter/testing/arms.h"

namespace armtrue {
namespace {

using testing::Random;

constexpr int kJoints = 3;

// `count` poses, each read `shots` times in separate visits; variances in the order of
// estimate_scatter.
std::vector<ScatterColumns> poses_with(const Eigen::VectorXd& variance, int count, int shots,
                                       Random& random) {
  std::vector<ScatterColumns> result;
  for (int pose = 0; pose < count; ++pose) {
    ScatterColumns p;
    Eigen::Matrix<double, 3, kJoints> lever;
    for (int k = 0; k < kJoints; ++k) lever.col(k) = testing::normal3(random, 1e4);
    p.columns = Eigen::MatrixXd::Zero(3 * shots, kJoints * shots + 3);
    p.residual.resize(3 * shots);
    for (int k = 0; k < kJoints; ++k)
      p.part.insert(p.part.end(), static_cast<std::size_t>(shots), k + 1);
    p.part.insert(p.part.end(), 3, kJoints + 1);
    const Eigen::Vector3d shared = testing::normal3(random, std::sqrt(variance[kJoints + 1]));
    for (int shot = 0; shot < shots; ++shot) {
      auto residual = p.residual.segment<3>(3 * shot);
      residual = testing::normal3(random, std::sqrt(variance[0])) + 1e5 * shared;
      p.columns.block<3, 3>(3 * shot, kJoints * shots) = 1e5 * Eigen::Matrix3d::Identity();
      for (int k = 0; k < kJoints; ++k) {
        p.columns.block<3, 1>(3 * shot, k * shots + shot) = lever.col(k);
        residual += testing::normal(random, std::sqrt(variance[k + 1])) * lever.col(k);
      }
    }
    p.own.assign(static_cast<std::size_t>(3 * shots), 0);
    result.push_back(std::move(p));
  }
  return result;
}

TEST(ScatterParts, VariancesOfSimulatedPartsAreRecovered) {
  Random random(1);
  Eigen::VectorXd truth = Eigen::VectorXd::Zero(kJoints + 3);
  truth[0] = 1.0;
  truth[2] = 4e-8;             // 200 urad of joint 2
  truth[kJoints + 1] = 4e-10;  // 20 um of every pose
  const Eigen::VectorXd found = estimate_scatter(poses_with(truth, 400, 3, random), kJoints);
  EXPECT_NEAR(found[0], 1.0, 0.1);
  EXPECT_NEAR(found[2], truth[2], 0.15 * truth[2]);
  EXPECT_NEAR(found[kJoints + 1], truth[kJoints + 1], 0.2 * truth[kJoints + 1]);
  EXPECT_EQ(found[1], 0.0);
  EXPECT_EQ(found[3], 0.0);
}

TEST(ScatterParts, ReadingNoiseOnly_OtherPartsAreAlmostAlwaysZero) {
  Eigen::VectorXd truth = Eigen::VectorXd::Zero(kJoints + 3);
  truth[0] = 1.0;
  int seen = 0;
  for (std::uint64_t seed = 2; seed < 42; ++seed) {
    Random random(seed);
    const Eigen::VectorXd found = estimate_scatter(poses_with(truth, 100, 2, random), kJoints);
    EXPECT_NEAR(found[0], 1.0, 0.2) << seed;
    for (int part = 1; part <= kJoints + 1; ++part) seen += found[part] > 0.0 ? 1 : 0;
  }
  EXPECT_LE(seen, 3);  // of 160
}

}  // namespace
}  // namespace armtrue
