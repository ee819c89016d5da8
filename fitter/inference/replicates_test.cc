#include "fitter/inference/replicates.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "fitter/testing/arms.h"

namespace armtrue {
namespace {

using testing::Random;

constexpr int kHeight = 3;

// `poses` poses with `shots` measurements each, and as many poses with one measurement.
struct Campaign {
  Measurements measurements;
  std::vector<std::size_t> rows;

  Campaign(int poses, int shots) {
    for (int pose = 0; pose < 2 * poses; ++pose) {
      for (int shot = 0; shot < (pose < poses ? shots : 1); ++shot) {
        measurements.repeat.push_back(pose);
        measurements.target.push_back(0);
      }
    }
    measurements.poses.pose_of_row = measurements.repeat;
    measurements.poses.poses = 2 * poses;
    rows.resize(measurements.repeat.size());
    std::iota(rows.begin(), rows.end(), std::size_t{0});
  }

  // Errors: `shared` common to the shots of a pose, `own` of each shot (standard deviations).
  Eigen::VectorXd errors(Random& random, double shared, double own) const {
    Eigen::VectorXd result(static_cast<Eigen::Index>(rows.size()) * kHeight);
    Eigen::Vector3d common = Eigen::Vector3d::Zero();
    for (std::size_t r = 0; r < rows.size(); ++r) {
      if (r == 0 || measurements.repeat[r] != measurements.repeat[r - 1])
        common = testing::normal3(random, shared);
      result.segment<3>(static_cast<Eigen::Index>(r) * kHeight) =
          common + testing::normal3(random, own);
    }
    return result;
  }
};

TEST(Replicates, CorrelationEstimateMatchesTheTrueOne) {
  const Campaign campaign(150, 4);
  const Replicates replicates(campaign.measurements, campaign.rows);
  Random random(1);
  for (const auto& [shared, own] :
       {std::pair{0.0, 1.0}, std::pair{0.5, 1.0}, std::pair{2.0, 1.0}}) {
    const double true_correlation = shared * shared / (shared * shared + own * own);
    EXPECT_NEAR(replicates.correlation(campaign.errors(random, shared, own), kHeight),
                true_correlation, 0.05);
  }
}

TEST(Replicates, WhitenedErrorsOfRepeatsAreUncorrelated) {
  const Campaign campaign(400, 3);
  const Replicates replicates(campaign.measurements, campaign.rows);
  Random random(2);
  Eigen::VectorXd errors = campaign.errors(random, 2.0, 1.0);
  replicates.whiten(errors, kHeight, 0.8);
  EXPECT_NEAR(errors.squaredNorm() / static_cast<double>(errors.size()), 5.0, 0.4);
  double product = 0.0;
  for (int pose = 0; pose < 400; ++pose)
    product += errors.segment<3>(pose * 9).dot(errors.segment<3>(pose * 9 + 3)) / 1200.0;
  EXPECT_NEAR(product, 0.0, 0.6);
}

TEST(Replicates, LogDeterminantMatchesTheCorrelationMatrix) {
  const Campaign campaign(1, 4);
  const Replicates replicates(campaign.measurements, campaign.rows);
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Identity(5, 5);
  matrix.topLeftCorner<4, 4>().setConstant(0.3);
  matrix.diagonal().setOnes();
  EXPECT_NEAR(replicates.log_determinant(0.3), std::log(matrix.determinant()), 1e-12);
}

TEST(Replicates, WithoutRepeats_WhitenChangesNothing) {
  Measurements measurements;
  const std::vector<std::size_t> rows{0, 1, 2};
  const Replicates replicates(measurements, rows);
  Eigen::VectorXd errors = Eigen::VectorXd::LinSpaced(9, -1.0, 1.0);
  const Eigen::VectorXd before = errors;
  EXPECT_FALSE(replicates.any());
  EXPECT_EQ(replicates.correlation(errors, kHeight), 0.0);
  replicates.whiten(errors, kHeight, 0.5);
  EXPECT_EQ(errors, before);
}

}  // namespace
}  // namespace armtrue
