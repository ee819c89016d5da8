#include "fitter/evidence/noise.h"

#include <gtest/gtest.h>

#include "fitter/evidence/restricted_likelihood.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::Random;

// A fit of geometry to `poses_measured` poses whose joints scatter by `joint_sigma` [rad]; each
// pose is read `readings` times with `reading_sigma` [m].
std::unique_ptr<Fit> scattered(std::uint64_t seed, const std::vector<double>& joint_sigma,
                               double reading_sigma, std::size_t readings,
                               std::size_t poses_measured = 300) {
  Random random(seed);
  const Problem p(testing::industrial_arm(), testing::geometry_model(),
                  {poses_measured, false, 1, 0.0, 0.0, {}}, random,
                  [](const Parameter&) { return 0.0; });
  // Positions are measured with the scattered joints; the file keeps the commanded ones.
  State::Columns columns = p.columns, stood = p.columns;
  for (std::size_t k = 0; k < joint_sigma.size(); ++k) {
    for (double& q : stood["q" + std::to_string(k + 1)])
      q += testing::normal(random, joint_sigma[k]);
  }
  const State state(p.robot, stood, Eigen::Vector3d::Zero());
  const std::vector<Pose> poses =
      predict_poses(state, p.measurements.target, p.model, *p.kinematics);
  State::Columns all;
  for (std::size_t r = 0; r < readings; ++r) {
    for (const auto& [name, values] : columns)
      all[name].insert(all[name].end(), values.begin(), values.end());
  }
  for (std::size_t i = 0; i < all["x"].size(); ++i) {
    const Eigen::Vector3d point =
        poses[i % poses.size()].translation() + testing::normal3(random, reading_sigma);
    all["x"][i] = point.x();
    all["y"][i] = point.y();
    all["z"][i] = point.z();
  }
  return Fit::run(p.robot, all, ModelSpecification::from_json(testing::geometry_model()), {});
}

NoiseParts estimated(Fit& fit) {
  const Linearization l = linearize(fit);
  const auto width = l.jacobian.cols();
  return estimate_noise(l, l.jacobian, Eigen::MatrixXd::Zero(width, width), -l.residual,
                        broad_noise(l, l.residual), {60, true});
}

// For a large set, slope and information are summed over some poses only, and must hold for all.
TEST(RestrictedLikelihood, ManyPoses_SlopeMatchesTheDerivativeOfTheValue) {
  const auto fit = scattered(8, {}, 8e-6, 1, 1300);
  const Linearization l = linearize(*fit);
  const auto width = l.jacobian.cols();
  const Eigen::MatrixXd precision = Eigen::MatrixXd::Zero(width, width);
  const RestrictedLikelihood likelihood(l, l.jacobian, precision, -l.residual);
  const auto with_reading = [&](double reading) {
    NoiseParts parts = broad_noise(l, l.residual);
    parts.reading = reading;
    return likelihood.score(parts);
  };
  const double at = 2.0, step = 1e-3;
  const double rise = with_reading(at + step).value - with_reading(at - step).value;
  const double by_variance = rise / (2.0 * step) / (2.0 * at);
  EXPECT_NEAR(with_reading(at).slope[0] / by_variance, 1.0, 0.1);
}

TEST(EstimateNoise, OnePoorlyRepeatingJoint_IsFoundWithItsScatter) {
  const auto fit = scattered(1, {4e-6, 4e-6, 45e-6, 4e-6, 4e-6, 4e-6}, 8e-6, 1);
  const Linearization l = linearize(*fit);
  const NoiseParts parts = estimated(*fit);
  EXPECT_NEAR(parts.joint[2], 45e-6, 8e-6);
  for (const std::size_t k : {0, 1, 3}) EXPECT_LT(parts.joint[k], 15e-6) << k;
  EXPECT_NEAR(parts.reading * l.typical_sigma, 8e-6, 1e-6);
  EXPECT_FALSE(parts.pose.has_value());
}

// At one metre, 4 urad of a joint move a point by half the scatter of its reading. The data do not
// determine the scatter of one such joint, but they determine the common scatter of five.
TEST(EstimateNoise, WellRepeatingJoints_ArePooled) {
  for (const std::uint64_t seed : {4, 5, 6, 7}) {
    const auto fit = scattered(seed, {4e-6, 45e-6, 4e-6, 4e-6, 4e-6, 4e-6}, 8e-6, 1);
    const NoiseParts parts = estimated(*fit);
    EXPECT_FALSE(parts.is_pooled(1)) << seed;
    for (const std::size_t k : {3, 4, 5}) {
      EXPECT_TRUE(parts.is_pooled(k)) << seed;
      EXPECT_NEAR(parts.joint[k], 4e-6, 3e-6) << seed;
    }
    EXPECT_NEAR(parts.reading * linearize(*fit).typical_sigma, 8e-6, 0.8e-6) << seed;
  }
}

TEST(EstimateNoise, ReadingNoiseOnly_GivesLittleScatterToJoints) {
  const auto fit = scattered(2, {}, 10e-6, 1);
  const Linearization l = linearize(*fit);
  const NoiseParts parts = estimated(*fit);
  EXPECT_NEAR(parts.reading * l.typical_sigma, 10e-6, 1e-6);
  for (const std::size_t k : {0, 1, 2}) EXPECT_LT(parts.joint[k], 6e-6) << k;
}

TEST(PoseWhitening, MakesCovarianceTheIdentity) {
  const auto fit = scattered(3, {5e-6, 2e-5}, 8e-6, 2);
  const Linearization l = linearize(*fit);
  NoiseParts parts;
  parts.reading = 1.3;
  parts.joint = {1e-5, 2e-5, 0.0, 0.0, 3e-5, 0.0};
  parts.pose = 5e-6;
  const PoseWhitening whitening(l, parts);
  // The covariance of the first pose's equations, written out.
  const PoseWhitening::Block& block = whitening.blocks().front();
  const auto size = static_cast<Eigen::Index>(block.equations.size());
  ASSERT_EQ(size, 6);
  Eigen::MatrixXd covariance = 1.3 * 1.3 * Eigen::MatrixXd::Identity(size, size);
  const Eigen::MatrixXd shared = l.translation(block.equations, Eigen::all);
  covariance += 25e-12 * shared * shared.transpose();
  for (std::size_t k = 0; k < parts.joint.size(); ++k) {
    // Both readings have the same time, and so belong to one visit.
    const Eigen::VectorXd column = l.geometry(block.equations, l.layout.motor(static_cast<int>(k)));
    covariance += parts.joint[k] * parts.joint[k] * column * column.transpose();
  }
  Eigen::MatrixXd both = Eigen::MatrixXd::Zero(l.equations(), size);
  const Eigen::MatrixXd root = covariance.llt().matrixL();
  for (Eigen::Index e = 0; e < size; ++e)
    both.row(block.equations[static_cast<std::size_t>(e)]) = root.row(e);
  whitening.apply(both);
  const Eigen::MatrixXd white = both(block.equations, Eigen::all);
  EXPECT_LT((white * white.transpose() - Eigen::MatrixXd::Identity(size, size)).norm(), 1e-9);
}

}  // namespace
}  // namespace armtrue
