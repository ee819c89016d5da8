#include "fitter/solve/information.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using testing::Problem;
using testing::Random;

std::unique_ptr<Fit> fitted(bool with_rotation) {
  Random random(72);
  const Problem p(testing::industrial_arm(), testing::geometry_model(),
                  {80, with_rotation, 1, 1e-5, 2e-5, {}}, random, testing::nothing);
  return Fit::run(p.robot, p.columns, ModelSpecification::from_json(testing::geometry_model()), {});
}

// 3 N log of the sum of squares, of positions and of orientations, plus the charge for unknowns
// (Schwarz 1978): valid if no pose is repeated and no row rejected.
double expected_of(Fit& fit) {
  double position = 0.0, rotation = 0.0;
  Design& design = fit.design();
  Design::Row row;
  for (std::size_t i = 0; i < design.rows(); ++i) {
    design.evaluate(i, false, row);
    position += row.residual.head<3>().squaredNorm();
    rotation += row.residual.tail<3>().squaredNorm();
  }
  const auto rows = static_cast<double>(design.rows());
  double value = 3.0 * rows * std::log(position * std::pow(fit.noise_scale(), 2));
  if (design.residuals_per_row() == 6)
    value += 3.0 * rows * std::log(rotation * std::pow(fit.measurements().sigma_rotation, 2));
  return value + fit.charge_for_unknowns(rows * design.residuals_per_row());
}

TEST(BayesianInformation, SumsPositionAndOrientationTermsAndTheCharge) {
  for (const bool with_rotation : {false, true}) {
    const std::unique_ptr<Fit> fit = fitted(with_rotation);
    EXPECT_NEAR(bayesian_information(*fit), expected_of(*fit), 1e-6) << with_rotation;
  }
}

// Each rejected row is charged with 64 times the mean square residual of those that are kept.
TEST(BayesianInformation, RejectingARow_RaisesBic) {
  const std::unique_ptr<Fit> fit = fitted(false);
  const double all = bayesian_information(*fit);
  Design& design = fit->design();
  Design::Row row;
  design.evaluate(7, false, row);
  const double before = expected_of(*fit);
  double squares = 0.0;
  for (std::size_t i = 0; i < design.rows(); ++i) {
    Design::Row own;
    design.evaluate(i, false, own);
    squares += own.residual.head<3>().squaredNorm();
  }
  design.weights()[7] = 0.0;
  const auto rows = static_cast<double>(design.rows());
  const double kept = squares - row.residual.head<3>().squaredNorm();
  const double expected =
      before + 3.0 * rows * std::log(kept * (1.0 + 64.0 / (rows - 1.0)) / squares);
  EXPECT_NEAR(bayesian_information(*fit), expected, 1e-6);
  EXPECT_GT(bayesian_information(*fit), all);
}

}  // namespace
}  // namespace armtrue
