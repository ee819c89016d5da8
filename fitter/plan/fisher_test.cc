#include "fitter/plan/fisher.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using testing::Problem;
using testing::Random;

constexpr double kSigma_m = 20e-6;

struct Spectra {
  Spectra() {
    Random random(71);
    const Problem p(testing::industrial_arm(), testing::geometry_model(), {50}, random,
                    testing::nothing);
    Design design = p.make_design();
    linearised.emplace(design, 1.0);
    information = linearised->known();
    std::vector<std::size_t> all(50);
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
    information += linearised->information_of(all);
  }
  FisherSpectrum at(double sigma, std::size_t reachable = 50) const {
    return fisher_spectrum(*linearised, information, sigma, reachable);
  }

  std::optional<Linearised> linearised;
  Eigen::MatrixXd information;
};

TEST(FisherSpectrum, EigenvaluesAreInUnitsOfTheReadingsSigma) {
  const Spectra spectra;
  const FisherSpectrum found = spectra.at(kSigma_m);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> expected(spectra.information);
  ASSERT_EQ(found.eigenvalues.size(), static_cast<std::size_t>(spectra.linearised->unknowns()));
  for (std::size_t k = 0; k < found.eigenvalues.size(); ++k) {
    const double value = expected.eigenvalues()[static_cast<Eigen::Index>(k)];
    EXPECT_NEAR(found.eigenvalues[k] * kSigma_m * kSigma_m, value, 1e-9 * value + 1e-12) << k;
  }
  ASSERT_EQ(found.weakest.size(), 3u);
  EXPECT_NEAR(found.weakest.front().sigma, 1.0 / std::sqrt(found.eigenvalues.front()), 1e-12);
}

// Mean over the reachable poses of the trace of J C Jᵀ.
TEST(FisherSpectrum, PredictionRmsIsOverTheReachablePoses) {
  const Spectra spectra;
  const Eigen::MatrixXd covariance = spectra.information.inverse();
  const Eigen::MatrixXd& jacobian = spectra.linearised->jacobian();
  for (const std::size_t reachable : {std::size_t{20}, std::size_t{50}}) {
    const Eigen::MatrixXd own = jacobian.topRows(3 * static_cast<Eigen::Index>(reachable));
    const double expected = kSigma_m * std::sqrt((own * covariance * own.transpose()).trace() /
                                                 static_cast<double>(reachable));
    EXPECT_NEAR(spectra.at(kSigma_m, reachable).prediction_rms, expected, 1e-6 * expected);
  }
}

}  // namespace
}  // namespace armtrue
